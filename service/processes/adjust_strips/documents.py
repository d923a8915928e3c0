"""What `adjust-strips` says: document, tables, the protocol in words."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from algorithms.arrays import Array, Points, Vector3
from algorithms.strips.adjustment import Adjusted
from algorithms.strips.block import GON
from algorithms.strips.control import ControlPatch
from algorithms.strips.control_plan import missing_control
from algorithms.strips.corrections import BORESIGHT, MOUNT, SHIFTS, TILTS
from algorithms.strips.determination import Coefficient, Determination
from algorithms.strips.discrepancies import Discrepancies, figures_of
from algorithms.strips.residual_blocks import BlockTest
from algorithms.strips.strip import Strip
from algorithms.strips.strip_block import StripBlock
from schemas.results.registration_result import Artifact
from schemas.results.strips_result import (
    AdjustedStrip,
    BlockMotion,
    ControlFigures,
    HeightDifferences,
    MismatchedPatch,
    PatchFigures,
    ResidualBlocks,
    StripAdjustment,
    StripCoefficient,
    StripsDocument,
    WaveSizes,
)
from service.formats.writers.csv_table import csv_text

MOST_MISMATCHED = 1000
MGON = GON * 1e-3
LEAST_LAG_SLOPE = 0.1
"""Flatter patches say nothing of a lag of the mirror: across them both directions look alike."""


WAVE_HEAD = (
    "strip", "gps_time_s", *(f"{name}_m" for name in SHIFTS), *(f"{name}_mgon" for name in TILTS),
    *(f"std_{name}_m" for name in SHIFTS), *(f"std_{name}_mgon" for name in TILTS),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Told:
    """All that is known."""

    strips: Sequence[Strip]
    trajectories: Sequence[str | None]
    origin_m: Vector3
    origin_s: float
    control: Sequence[ControlPatch]
    block: StripBlock
    determination: Determination
    before: Discrepancies
    after: Discrepancies
    sources: Sequence[int | None]
    """Point source by which each strip was told from others of its files."""
    remarks: Sequence[str]
    waves_wanted: bool

    @property
    def adjusted(self) -> Adjusted:
        """The adjustment."""
        return self.block.adjusted


def document_of(told: Told, artifacts: list[Artifact], corrected: list[Artifact] | None) -> StripsDocument:
    """Describe everything."""
    patches = _patches(told)
    boresight, common = (
        [_coefficient(each) for each in told.determination.coefficients if each.parameter in names]
        for names in (BORESIGHT, MOUNT)
    )
    control = _control(told)
    datum = [
        BlockMotion(
            name=each.name,
            unit="m" if each.name.startswith("shift") else "mgon",
            std=each.std / _unit(each.name),
            zero_std=each.zero_std / _unit(each.name),
            determined=each.determined,
            advice=None if each.determined else f"add {each.advice}",
        )
        for each in told.determination.motions
    ]
    heights = [
        HeightDifferences(cell_m=each.grid.cell_m, **asdict(figures_of(each.differences_m)))
        for each in (told.before, told.after)
    ]
    return StripsDocument(
        conclusion=_conclusion(told, patches, datum),
        strips=[_strip(told, number) for number in range(len(told.strips))],
        boresight=boresight,
        common=common,
        waves=_waves(told),
        patches=patches,
        mismatched=_mismatched(told),
        control=control,
        datum=datum,
        advice=_advice(told),
        regularisation=_protocol(told),
        remarks=list(told.remarks),
        heights_before=heights[0],
        heights_after=heights[1],
        adjustment=_adjustment(told.adjusted),
        artifacts=artifacts,
        corrected=corrected,
    )


def tables_of(told: Told) -> dict[str, tuple[str, bytes]]:
    """Write patches and coefficients as tables."""
    adjusted, ties = told.adjusted, told.adjusted.block.ties
    middles = ties.anchors_m.mean(axis=1) + told.origin_m
    normals = adjusted.block.frames[ties.patches][:, :, 2]
    rows = (
        (
            int(ties.patches[k]), told.strips[int(ties.strips[k])].name, *(f"{value:.3f}" for value in middles[k]),
            *(f"{value:.4f}" for value in normals[k]), int(ties.points[k]), f"{ties.rms_m[k]:.4f}",
            f"{adjusted.gaps_before_m[k, 0]:.4f}", f"{adjusted.residuals_m[k, 0]:.4f}",
            f"{adjusted.statistics[k]:.2f}", f"{adjusted.lifts[k]:.2f}", int(adjusted.used[k]), int(adjusted.paired[k]),
        )
        for k in range(len(ties))
    )  # fmt: skip
    head = (
        "patch", "strip", "x_m", "y_m", "z_m", "normal_x", "normal_y", "normal_z", "points", "rms_m", "gap_before_m",
        "gap_after_m", "statistic", "statistic_of_shift", "used", "tied",
    )  # fmt: skip
    of_coefficients = (
        (
            "" if each.strip is None else told.strips[each.strip].name, each.parameter, each.power, figures.unit,
            f"{figures.value:.6g}", f"{figures.std:.6g}", f"{figures.zero_std:.6g}", f"{each.data_share:.4f}",
            int(each.held), int(each.significant), int(each.observed_as_zero),
        )
        for each, figures in ((each, _coefficient(each)) for each in told.determination.coefficients)
    )  # fmt: skip
    names = (
        "strip", "parameter", "power", "unit", "value", "std", "zero_std", "data_share", "held", "significant",
        "observed_as_zero",
    )  # fmt: skip
    waves = {"waves.csv": ("text/csv", csv_text(WAVE_HEAD, _wave_rows(told)).encode())} if adjusted.block.knots else {}
    return waves | {
        "patches.csv": ("text/csv", csv_text(head, rows).encode()),
        "corrections.csv": ("text/csv", csv_text(names, of_coefficients).encode()),
    }


def _wave_rows(told: Told) -> Iterator[tuple[str, ...]]:
    """Yield the values of waves at the knots of each strip, with their standard deviations."""
    adjusted, block = told.adjusted, told.adjusted.block
    stds = np.sqrt(np.diag(adjusted.whole_cofactors))[block.before_waves :]
    units = np.array([1.0] * len(SHIFTS) + [MGON] * len(TILTS))
    bounds = block.wave_starts - block.before_waves
    for strip, knots, first, last in zip(told.strips, block.knots, bounds[:-1], bounds[1:], strict=True):
        values, own = (each[first:last].reshape(-1, len(units)) / units for each in (adjusted.state.waves, stds))
        for time_s, value, std in zip(knots.times_s + told.origin_s, values, own, strict=True):
            yield strip.name, f"{time_s:.3f}", *(f"{each:.4f}" for each in (*value, *std))


def _waves(told: Told) -> WaveSizes | None:
    if not told.adjusted.block.knots:
        return None
    sizes = told.adjusted.sizes
    return WaveSizes(
        plan_m=sizes.plan_m, height_m=sizes.height_m, tilt_mgon=sizes.tilt_rad / MGON, time_s=sizes.time_s
    )  # fmt: skip


def _unit(parameter: str) -> float:
    return 1.0 if parameter.startswith("shift") else MGON


def _coefficient(each: Coefficient) -> StripCoefficient:
    unit = _unit(each.parameter)
    return StripCoefficient(
        parameter=each.parameter,
        power=each.power,
        unit="m" if unit == 1.0 else "mgon",
        value=each.value / unit,
        std=each.std / unit,
        zero_std=each.zero_std / unit,
        observed_as_zero=each.observed_as_zero,
        data_share=each.data_share,
        held=each.held,
        statistic=each.statistic,
        critical=each.critical,
        significant=each.significant,
    )


def _rms(values: Array) -> float | None:
    return float(np.sqrt((values**2).mean())) if len(values) else None


def _strip(told: Told, number: int) -> AdjustedStrip:
    strip, adjusted, found = told.strips[number], told.adjusted, told.determination
    ties = adjusted.block.ties
    own = (ties.strips == number) & adjusted.paired
    forward = strip.path.axes[:2, 0]
    return AdjustedStrip(
        name=strip.name,
        point_source=told.sources[number],
        points=len(strip.points),
        scan_lines=told.block.lines[number],
        looks_back=told.block.looks_back[number],
        first_s=float(strip.times_s[0]) + told.origin_s,
        last_s=float(strip.times_s[-1]) + told.origin_s,
        azimuth_gon=float(np.arctan2(forward[0], forward[1]) / GON) % 400.0,
        trajectory=told.trajectories[number],
        candidates=told.block.candidates[number],
        patches=int(own.sum()),
        mismatched=int(((ties.strips == number) & ~adjusted.used).sum()),
        scan_lag_m=_lag(told, number),
        largest_correction_m=float(found.largest_m[number]),
        correction_std_m=float(found.point_std_m[number]),
        correction_std_xyz_m=found.axis_stds_m[number].tolist(),
        rms_before_m=_rms(adjusted.gaps_before_m[own, 0]),
        rms_after_m=_rms(adjusted.residuals_m[own, 0]),
        coefficients=[_coefficient(each) for each in found.coefficients if each.strip == number],
    )


def _lag(told: Told, number: int) -> float | None:
    """Average the lags along the normals of inclined patches, by which side of the flight they face."""
    ties, block = told.adjusted.block.ties, told.adjusted.block
    known = (ties.strips == number) & np.isfinite(ties.lag_m)
    leaning = block.frames[ties.patches][:, :, 2] @ told.strips[number].path.axes[:, 1]
    known &= np.abs(leaning) > LEAST_LAG_SLOPE
    if not known.any():
        return None
    weights = ties.lag_std_m[known] ** -2
    return float((weights * ties.lag_m[known] * np.sign(leaning[known])).sum() / weights.sum())


def _patches(told: Told) -> PatchFigures:
    adjusted, ties = told.adjusted, told.adjusted.block.ties
    count = len(adjusted.block.references_m)
    seen = np.bincount(ties.patches, minlength=count)
    known = np.bincount(adjusted.block.control.patches, minlength=count) > 0
    tied = (seen >= 2) | ((seen >= 1) & known)
    observed, wrong = tied[ties.patches], tied[ties.patches] & ~adjusted.used
    numbers, counts = np.unique(seen[tied], return_counts=True)
    return PatchFigures(
        sought=told.block.sought,
        tied=int(tied.sum()),
        observations=int(observed.sum()),
        mismatched=int(wrong.sum()),
        mismatched_share=float(wrong.sum() / max(int(observed.sum()), 1)),
        strips_per_patch={str(n): int(c) for n, c in zip(numbers.tolist(), counts.tolist(), strict=True)},
        rms_before_m=_rms(adjusted.gaps_before_m[adjusted.paired, 0]),
        rms_after_m=_rms(adjusted.residuals_m[adjusted.paired, 0]),
    )


def _mismatched(told: Told) -> list[MismatchedPatch]:
    adjusted, ties = told.adjusted, told.adjusted.block.ties
    wrong = np.flatnonzero(~adjusted.used)
    statistics, limits = adjusted.failed_by
    worst = wrong[np.argsort(-(statistics / limits)[wrong], kind="stable")][:MOST_MISMATCHED]
    places = ties.anchors_m.mean(axis=1) + told.origin_m
    return [
        MismatchedPatch(
            patch=int(ties.patches[k]),
            strip=told.strips[int(ties.strips[k])].name,
            x_m=float(places[k, 0]),
            y_m=float(places[k, 1]),
            z_m=float(places[k, 2]),
            gap_m=float(adjusted.residuals_m[k, 0]),
            statistic=float(statistics[k]),
            critical=float(limits[k]),
        )
        for k in worst.tolist()
    ]


def _control(told: Told) -> list[ControlFigures]:
    adjusted, found = told.adjusted, []
    ties, known = adjusted.block.ties, adjusted.block.control
    for control, patch in zip(told.control, told.block.control_patches.tolist(), strict=True):
        rows = np.flatnonzero(known.patches == patch) if patch >= 0 else np.zeros(0, dtype=np.int64)
        strips = sorted(set(ties.strips[(ties.patches == patch) & adjusted.used].tolist())) if patch >= 0 else []
        kept = int(adjusted.control_used[rows].sum())
        reason = None
        if not strips:
            reason = "no strip shows a plane there: see that it is free of plants, and large enough for `size_m`"
        elif kept < len(rows):
            reason = f"{len(rows) - kept} of its {len(rows)} points contradict the strips and each other"
        seen = bool(strips)
        found.append(
            ControlFigures(
                name=control.name,
                points=len(control.points_m),
                strips=[told.strips[k].name for k in strips],
                used=seen and kept > 0,
                before_m=float(adjusted.control_before_m[rows].mean()) if seen else None,
                after_m=float(adjusted.control_m[rows].mean()) if seen else None,
                reason=reason,
            )
        )
    return found


def _adjustment(adjusted: Adjusted) -> StripAdjustment:
    ties = int(adjusted.used.sum())
    patches = np.unique(
        np.concatenate(
            [adjusted.block.ties.patches[adjusted.used], adjusted.block.control.patches[adjusted.control_used]]
        )
    )
    test, given_up = adjusted.test, int((adjusted.zero_weights == 0.0).sum())
    return StripAdjustment(
        observations=3 * ties + int(adjusted.control_used.sum()) + adjusted.block.count - given_up,
        unknowns=adjusted.block.count + 3 * len(patches),
        redundancy=test.redundancy,
        sigma0=float(np.sqrt(test.omega / test.redundancy)) if test.redundancy > 0 else None,
        verdict=test.verdict.value,
        variance_factor=adjusted.variance_factor,
        block_factor=adjusted.block_factor,
        along=_blocks(adjusted.along),
        across=_blocks(adjusted.across),
        iterations=adjusted.iterations,
    )


def _blocks(test: BlockTest) -> ResidualBlocks:
    return ResidualBlocks(
        statistic=test.statistic, degrees=test.degrees, factor=test.factor, correlated=test.significant
    )  # fmt: skip


def _protocol(told: Told) -> list[str]:
    """Say which coefficients the data do not determine, which swings were suppressed, which zeros were given up."""
    lines = []
    names = [strip.name for strip in told.strips]
    found = told.determination
    groups = [(name, [each for each in found.coefficients if each.strip == k]) for k, name in enumerate(names)]
    for name, parameters in (("bore-sight", BORESIGHT), ("all strips", MOUNT)):
        groups.append((name, [each for each in found.coefficients if each.parameter in parameters]))
    for name, own in groups:
        held = [each for each in own if each.held]
        if held:
            words = ", ".join(
                f"{_term(each)} ± {_coefficient(each).std:.3g} {_coefficient(each).unit}" for each in held
            )
            lines.append(f"{name}: not determined by the data, held by observations of zero: {words}")
        lines += [
            f"{name}: the observation that {_term(each)} is zero ± {_coefficient(each).zero_std:.3g} "
            f"{_coefficient(each).unit} contradicts the data and was given up (it is {_coefficient(each).value:.4g})"
            for each in own
            if not each.observed_as_zero
        ]
    lines += [
        f"{names[each.strip]}: oscillation suppressed: without observations of zero for powers of time above 1 the "
        f"correction would swing to {each.without_m:.2f} m where no patches hold it, now {each.largest_m:.2f} m at most"
        for each in found.oscillations
    ]
    return lines


def _term(each: Coefficient) -> str:
    return each.parameter if each.power == 0 else f"{each.parameter} t{'' if each.power == 1 else f'^{each.power}'}"


def _advice(told: Told) -> list[str]:
    adjusted = told.adjusted
    words = [
        f"{each.name} of the whole block is not determined ({each.std / _unit(each.name):.3g} "
        f"{'m' if _unit(each.name) == 1.0 else 'mgon'}, which observations of zero alone would give too): "
        f"add {each.advice}"
        for each in told.determination.motions
        if not each.determined
    ]
    ties = adjusted.block.ties.anchors_m[adjusted.paired].mean(axis=1) if adjusted.paired.any() else np.zeros((0, 3))
    known: Points = adjusted.block.control.points_m[adjusted.control_used]
    words += missing_control([strip.path for strip in told.strips], ties, known, told.origin_m)
    tied = np.bincount(adjusted.block.ties.strips[adjusted.paired], minlength=len(told.strips))
    words += [
        f"{strip.name} has no patch in common with others: it stays as it is; fly more overlap or cross strips"
        for strip, count in zip(told.strips, tied.tolist(), strict=True)
        if count == 0
    ]
    if any(strip.trajectory is None for strip in told.strips):
        blind = ", ".join(strip.name for strip in told.strips if strip.trajectory is None)
        words.append(
            f"{blind}: no trajectory says where the scanner was and how it was held, so that a bore-sight is estimated "
            f"only as shifts and turns in common ({_std_of_common(told)}); give `trajectories` to have it by itself"
            if adjusted.block.with_mount
            else f"{blind}: no trajectory says where the scanner was and how it was held, and `boresight` is false: "
            "standard deviations hold only where there is no bore-sight; give `trajectories`, or leave `boresight` true"
        )
    words += [
        f"residuals {way} the strips are correlated: they are errors that the corrections do not follow; variances are "
        f"{test.factor:.1f} times those of independent patches for it. {remedy}"
        for way, test, remedy in (
            ("along", adjusted.along, "Raise `shift_degree` or `tilt_degree`, or have the trajectory computed again"),
            ("across", adjusted.across, "See to the calibration of the scanner: mirror scale, lag and ranges"),
        )
        if test.significant
    ]
    if not adjusted.block.knots:
        words.append(
            "waves within strips are not modelled, because "
            + ("the block has too many strips: divide it" if told.waves_wanted else "`waves` is false")
            + "; standard deviations do not contain what is common to neighbouring strips"
        )
    return words


def _std_of_common(told: Told) -> str:
    """Write the standard deviations of what all strips have in common."""
    return ", ".join(
        f"{each.parameter} ± {_coefficient(each).std:.2g} {_coefficient(each).unit}"
        for each in told.determination.coefficients
        if each.parameter in MOUNT
    )


def _conclusion(told: Told, patches: PatchFigures, datum: Sequence[BlockMotion]) -> str:
    open_ones = [each.name for each in datum if not each.determined]
    before, after = patches.rms_before_m, patches.rms_after_m
    words = f"{patches.tied} patches tie {len(told.strips)} strips"
    if before is not None and after is not None:
        words += f"; their distances from common planes fell from {before:.3f} to {after:.3f} m (rms)"
    words += f"; {patches.mismatched} of {patches.observations} observations of patches were left out"
    if open_ones:
        words += f"; not determined for the whole block: {', '.join(open_ones)}"
    else:
        words += "; control determines place and attitude of the block"
    if told.adjusted.block.with_mount:
        words += "; without trajectories a bore-sight is estimated only as shifts and turns that strips have in common"
    elif any(strip.trajectory is None for strip in told.strips):
        words += "; without trajectories standard deviations hold only where there is no bore-sight"
    if told.adjusted.along.significant or told.adjusted.across.significant:
        words += "; residuals are correlated: the corrections do not follow all errors of the strips"
    return words
