"""The step of `adjust`: find start values, search for gross errors, adjust, test, describe, store."""

import time
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from algorithms.adjustment.hybrid.congruence import congruence
from algorithms.adjustment.hybrid.datum import common_motions
from algorithms.adjustment.hybrid.gross_errors import Cleaned, GrossErrorOptions, clean
from algorithms.adjustment.hybrid.start_values import complete_start
from algorithms.adjustment.hybrid.state import Kind, State
from algorithms.adjustment.testing import global_test, noncentrality, normal_critical_value, tau_critical_value
from algorithms.arrays import Array
from algorithms.errors import InvalidInputError
from algorithms.progress import ProgressSection
from schemas.results.adjust_result import (
    AdjustDocument,
    AdjustProvenance,
    CongruenceDocument,
    GlobalTestDocument,
    LevelsDocument,
    MovedPoint,
    OtherDatumDocument,
    ScannersDocument,
)
from schemas.results.registration_result import Artifact
from service.ports import Json, StepContext
from service.processes.adjust.answers import Answer, answer_in_datum, answer_in_other_datum
from service.processes.adjust.documents import (
    datum_document,
    group_documents,
    mean_stds,
    parameter_documents,
    point_documents,
    station_documents,
)
from service.processes.adjust.left_out import MOST_ROWS, Judgement, explanations, judged
from service.processes.adjust.named_network import NamedNetwork
from service.processes.adjust.network_reading import read_network
from service.processes.adjust.reliability_documents import (
    MOST_LISTED,
    check_documents,
    correlation_documents,
    fictitious_documents,
    form_documents,
    listed_observations,
    object_documents,
    observation_columns,
    removal_documents,
)
from service.processes.adjust.report_page import report_page
from service.processes.adjust.scanner_errors import scanners_document, significant_errors, with_scanner_errors
from service.processes.adjust.tables import observations_csv, points_csv, stations_csv
from service.use_cases.steps.run_lines_report import software

FAR = 0.1
"""Of the extent of a network: approximate values are expected to be nearer than this."""
MOST_COMPARED = 1000
"""Common points of two epochs."""
STEPS: dict[str, Json] = {
    "haring": {"screening_m": 0.5, "robust": True, "snooping": True},
    "snooping": {"screening_m": None, "robust": False, "snooping": True},
    "robust": {"screening_m": None, "robust": True, "snooping": False},
    "none": {"screening_m": None, "robust": False, "snooping": False},
}


def adjust(context: StepContext, arguments: Json) -> Json:
    """Adjust, and store result document and downloads."""
    job_id = arguments["job_id"]
    document, files = adjusted_document(arguments["inputs"], job_id, ProgressSection(context.progress, 0.0, 0.95))
    for name, (_, data) in files.items():
        context.blobs.write_bytes(f"jobs/{job_id}/artifacts/{name}", data)
    context.blobs.write_bytes(f"jobs/{job_id}/result.json", document.model_dump_json(by_alias=True).encode())
    return {"sigma0": document.sigma0, "redundancy": document.redundancy}


def adjusted_document(inputs: Json, job_id: str, progress: Any) -> tuple[AdjustDocument, dict[str, tuple[str, bytes]]]:
    """Compute the result document and the downloads of a validated request."""
    started = time.perf_counter()
    progress.report(0.0, "reading")
    named = read_network(inputs["network"], inputs["datum"])
    read = time.perf_counter()
    cleaned, reference, how = _cleaned(named, inputs, progress)
    answer = answer_in_datum(named, cleaned, inputs, reference)
    scanners = None
    asked = inputs.get("scanner")
    if asked is not None and asked["estimate"] not in ("none", []):
        scanners, applied = _scanners(answer, inputs, asked)
        if applied is not None:
            answer, named, cleaned = applied, applied.named, applied.cleaned
    adjusted = time.perf_counter()
    progress.report(0.9, "testing")
    points, stations = point_documents(answer), station_documents(answer)
    rows = observation_columns(answer, inputs["alpha"], inputs["power"])
    other = None
    if inputs["other_datum"] is not None:
        carried = answer_in_other_datum(answer, inputs["other_datum"], reference)
        other = OtherDatumDocument(
            datum=datum_document(carried), points=point_documents(carried), stations=station_documents(carried)
        )
    compared, remarks = None, _remarks(answer, how, reference)
    judgement, explained = _judgement(answer, inputs)
    remarks = [*dict.fromkeys([*judgement.doubts, *explained]), *remarks]
    if inputs["epoch"] is not None:
        progress.report(0.92, "second epoch")
        compared = _congruence(answer, inputs, remarks)
    files: dict[str, tuple[str, bytes]] = {
        "observations.csv": ("text/csv", observations_csv(rows).encode()),
        "points.csv": ("text/csv", points_csv(points).encode()),
        "stations.csv": ("text/csv", stations_csv(stations).encode()),
    }
    found = answer.estimate
    test = global_test(found.omega, found.redundancy, inputs["alpha_global"])
    testable = found.redundancy > 0
    document = AdjustDocument(
        status=_status(answer, judgement), doubts=list(judgement.doubts), explanations=list(explained),
        observations_used=found.used, unknowns=named.network.layout.count, rank_defect=answer.defect.count,
        redundancy=found.redundancy, omega=found.omega, sigma0_prior=1.0, sigma0=found.sigma0,
        covariance_sigma0=f"{inputs['covariance_scale']} sigma0", iterations=cleaned.estimate.iterations,
        converged=found.converged, start_values=how, datum=datum_document(answer),
        levels=LevelsDocument(
            alpha=inputs["alpha"], power=inputs["power"], critical_w=normal_critical_value(inputs["alpha"]),
            critical_tau=tau_critical_value(inputs["alpha"], found.redundancy),
            delta0=noncentrality(inputs["alpha"], inputs["power"]),
        ),
        global_test=GlobalTestDocument(
            statistic=test.omega, redundancy=test.redundancy, alpha=test.alpha,
            lower=test.lower if testable else None, upper=test.upper if testable else None,
            passed=test.verdict == "accepted" if testable else None, verdict=test.verdict.value,
        ),
        groups=group_documents(answer), mean_std=mean_stds(points, stations), points=points, stations=stations,
        parameters=parameter_documents(answer, inputs["alpha"]), scanners=scanners,
        observations=listed_observations(rows, normal_critical_value(inputs["alpha"])),
        removals=removal_documents(answer), reinstated=len(cleaned.reinstated),
        object_tests=object_documents(answer, inputs["alpha"]), fictitious=fictitious_documents(answer),
        correlations=correlation_documents(answer), weakest_forms=form_documents(answer),
        checks=check_documents(answer), other_datum=other, congruence=compared, artifacts=[], remarks=remarks,
        provenance=AdjustProvenance(
            software=software(), options={k: v for k, v in inputs.items() if k not in {"network", "epoch"}},
            timings_s={
                "read": read - started, "adjust": adjusted - read, "describe": time.perf_counter() - adjusted
            },
        ),
    )  # fmt: skip
    files["report.html"] = ("text/html", report_page(document).encode())
    document.artifacts = [
        Artifact(name=name, type=media, bytes=len(data), href=f"/jobs/{job_id}/artifacts/{name}")
        for name, (media, data) in files.items()
    ]
    return document, files


def _status(
    answer: Answer, judgement: Judgement
) -> Literal["adjusted", "partly-determined", "doubtful", "not-converged"]:
    if not answer.estimate.converged:
        return "not-converged"
    if judgement.doubts:
        return "doubtful"
    return "partly-determined" if len(answer.estimate.fictitious) else "adjusted"


def _judgement(answer: Answer, inputs: Json) -> tuple[Judgement, tuple[str, ...]]:
    """Judge what was left out; where that raises doubts, look for the mistake that would explain it."""

    def judge(network: Json, datum: Json) -> Judgement:
        # a mistake is found when half of what was left out need not be: so few are looked for one by one
        share = max(0.5 * found.left_out, 1.0) / found.of
        named = read_network(network, datum)
        cleaned = _cleaned(named, {**inputs, "gross_errors": "snooping", "max_removed_share": share}, _Silent())[0]
        return judged(named, cleaned, share, inputs)

    found = judged(answer.named, answer.cleaned, inputs["max_removed_share"], inputs)
    if not found.asks_for_explanation:
        return found, ()
    if len(answer.named.rows) > MOST_ROWS:
        untried = "the network is too large to try which mistake would explain it"
        return found, (untried,) if found.doubts else ()
    explained = explanations(inputs["network"], inputs["datum"], found, judge)
    return replace(found, doubts=found.doubts or explained), explained


def _scanners(without: Answer, inputs: Json, asked: Json) -> tuple[ScannersDocument, Answer | None]:
    """Adjust with errors of the scanners as unknowns, and once more with those alone that are to be applied."""

    def adjusted(network: Json) -> Answer:
        named = read_network(network, inputs["datum"])
        cleaned, reference, _ = _cleaned(named, inputs, _Silent())
        return answer_in_datum(named, cleaned, inputs, reference)

    looked_for = with_scanner_errors(inputs["network"], asked)
    everything = adjusted(looked_for.network)
    wanted = {(scanner, error) for scanner, error, _ in looked_for.added}
    if asked["estimate"] == "auto":
        wanted = significant_errors(everything, looked_for, inputs["alpha"])
    applied = asked["apply"] and bool(wanted)
    document = scanners_document(without, everything, looked_for, inputs["alpha"], applied=applied)
    return document, adjusted(looked_for.only(wanted, inputs["network"])) if applied else None


def _cleaned(named: NamedNetwork, inputs: Json, progress: Any) -> tuple[Cleaned, State | None, str]:
    """Find start values where they are missing, and adjust without gross errors.

    Raises
    ------
    InvalidInputError
        More observations would have to be left out than the request allows, or there is nothing to determine.
    """
    if named.network.layout.count == 0:
        raise InvalidInputError("network", "everything in it is constant", "leave something unknown")
    started = complete_start(
        named.network, named.start, named.points_known, named.poses_known, named.mounts_known, named.photos,
        named.levelled, ProgressSection(progress, 0.0, 0.2),
    )  # fmt: skip
    missing = [name for name, placed in zip(named.stations, started.poses_placed, strict=True) if not placed]
    if missing:
        raise InvalidInputError(
            "approximate values",
            f"no start values were found for {', '.join(missing[:10])}",
            "give `approx`, or observe three points in common with stations that are known already, photos four",
        )
    wanted = inputs["gross_errors"]
    steps: Json = STEPS[wanted] if isinstance(wanted, str) else wanted
    options = GrossErrorOptions(
        screening_m=steps["screening_m"], robust=steps["robust"], snooping=steps["snooping"],
        variance_components=inputs["variance_components"], alpha=inputs["alpha"], power=inputs["power"],
        max_removed_share=inputs["max_removed_share"], max_iterations=inputs["max_iterations"],
    )  # fmt: skip
    cleaned = clean(
        named.network, started.state, named.groups, named.fictitious, options, ProgressSection(progress, 0.2, 0.9)
    )
    everything = bool(named.points_known.all() and named.poses_known.all())
    return cleaned, named.start if everything else None, started.how


def _far_from_approximate(answer: Answer, reference: State) -> str:
    """Name what lies farthest from its approximate value in the frame of these; empty where nothing is far."""
    named, state = answer.named, answer.state
    found = np.concatenate([state.points, state.positions])
    gaps = np.linalg.norm(found - np.concatenate([reference.points, reference.positions]), axis=1)
    k = int(np.argmax(gaps))
    if gaps[k] <= FAR * float(np.ptp(found, axis=0).max()):
        return ""
    return (
        f"{[*named.points, *named.stations][k]} lies {gaps[k]:.3g} m from its approximate value, though the free "
        "network is laid onto these: correct those that are wrong, for they tell its frame, and its scale if it is free"
    )


def _remarks(answer: Answer, how: str, reference: State | None) -> list[str]:
    remarks = []
    if answer.defect.count and reference is not None and (far := _far_from_approximate(answer, reference)):
        remarks.append(far)
    found, datum = answer.estimate, answer.datum["type"]
    if not found.converged:
        remarks.append("the adjustment did not settle: its figures are those of the last round")
    if answer.defect.count and datum in {"control", "held"}:
        free = ", ".join(answer.defect.named())
        remarks.append(f"the datum leaves free: {free}; there the trace of all unknowns is smallest instead")
    if answer.defect.count and datum == "minimal":
        free = ", ".join(answer.defect.named())
        remarks.append(f"the held coordinates leave free: {free}")
    if len(answer.named.rows) > MOST_LISTED:
        remarks.append("only removed and suspicious observations are listed here; all are in observations.csv")
    if len(found.fictitious):
        remarks.append(
            f"{len(found.fictitious)} unknowns are determined by no observation; a fictitious observation of the start "
            "value was inserted for each, and what depends on it has no standard deviation"
        )
    if how != "given":
        remarks.append(f"start values: {how}")
    return remarks


def _congruence(answer: Answer, inputs: Json, remarks: list[str]) -> CongruenceDocument | None:
    """Adjust the second epoch in the same way and compare the points that both have."""
    later = read_network(inputs["epoch"], inputs["datum"])
    # one datum for both: coordinates relative to the same origin
    cleaned, reference, _ = _cleaned(later, inputs, _Silent())
    second = answer_in_datum(later, cleaned, inputs, reference)
    known = set(later.points)
    names = [
        name for k, name in enumerate(answer.named.points)
        if name in known and _is_determined(answer, k) and _is_determined(second, later.points.index(name))
    ]  # fmt: skip
    if not 0 < len(names) <= MOST_COMPARED:
        remarks.append(f"the epochs have {len(names)} common points: 1 to {MOST_COMPARED} can be compared")
        return None
    coordinates, covariance = [], np.zeros((3 * len(names), 3 * len(names)))
    combinations = []
    for each in (answer, second):
        numbers = [each.named.points.index(name) for name in names]
        coordinates.append(each.state.points[numbers] + each.named.origin_m)
        columns = each.named.network.layout.columns[Kind.POINT][numbers].ravel()
        covariance += _full_covariance(each, columns)
        combinations.append(each.defect.combinations)
    free = np.concatenate(combinations, axis=1)
    basis = np.zeros((3 * len(names), 0))
    if free.shape[1]:
        # the motions of either epoch, about the points of the first
        numbers = [answer.named.points.index(name) for name in names]
        padded = np.vstack([common_motions(answer.named.network.layout, answer.state), np.zeros((1, 7))])
        motions = padded[answer.named.network.layout.columns[Kind.POINT][numbers].ravel()]
        directions, sizes, _ = np.linalg.svd(motions @ free, full_matrices=False)
        basis = directions[:, sizes > 1e-9 * sizes[0]]
        coordinates[1] = _carried(coordinates[1], coordinates[0], scale=free[6].any())
    test = congruence(coordinates[1] - coordinates[0], covariance, basis, inputs["alpha"])
    order = [*test.order, *(k for k in range(len(names)) if k not in test.order)]
    from algorithms.probabilities import chi2_sf

    return CongruenceDocument(
        points=len(names), statistic=test.statistic, degrees_of_freedom=test.degrees_of_freedom, p_value=test.p_value,
        congruent=not test.moved.any(), remaining_statistic=test.remaining_statistic,
        remaining_degrees_of_freedom=test.remaining_degrees_of_freedom,
        differences=[
            MovedPoint(
                id=names[k], displacement_m=_three(test.displacements[k]),
                std_m=_three(np.sqrt(np.maximum(np.diag(test.covariances[k]), 0.0))),
                statistic=float(test.statistics[k]), p_value=float(chi2_sf(test.statistics[k], 3)),
                moved=bool(test.moved[k]),
            )
            for k in order
        ],
        sigma0=second.estimate.sigma0, removed=int((~cleaned.used).sum()),
    )  # fmt: skip


def _is_determined(answer: Answer, point: int) -> bool:
    columns = answer.named.network.layout.columns[Kind.POINT][point : point + 1]
    return bool(answer.determined(columns)[0])


def _full_covariance(answer: Answer, columns: Array) -> Array:
    free = np.flatnonzero(columns >= 0)
    right = np.zeros((answer.named.network.layout.count, len(free)))
    right[columns[free], np.arange(len(free))] = 1.0
    covariance = np.zeros((len(columns), len(columns)))
    covariance[np.ix_(free, free)] = answer.scale * answer.cofactors.times(right)[columns[free]]
    return covariance


def _carried(points: Array, onto: Array, *, scale: bool) -> Array:
    """Move points as a whole onto others, robustly: what moved itself shall not drag the rest along."""
    from algorithms.adjustment.hybrid.closed_forms import robust_similarity

    factor, rotation, shift = robust_similarity(points, onto, with_scale=scale)
    return np.asarray(factor * points @ rotation.T + shift)


def _three(values: Array) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


class _Silent:
    def report(self, fraction: float, message: str) -> None:
        """Say nothing."""
