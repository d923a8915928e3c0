"""Documents of observations, their tests, and where the network is weak."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from algorithms.adjustment.hybrid.forms import effects_on_points, high_correlations, weakest_forms
from algorithms.adjustment.hybrid.reliability import object_test
from algorithms.adjustment.hybrid.state import Kind
from algorithms.adjustment.testing import noncentrality
from algorithms.arrays import Array
from algorithms.probabilities import chi2_sf
from schemas.results.adjust_result import (
    CheckDocument,
    CorrelationDocument,
    FictitiousDocument,
    ObjectTestDocument,
    ObservationDocument,
    RemovalDocument,
    WeakFormDocument,
)
from service.processes.adjust.answers import Answer
from service.processes.adjust.documents import vector_of
from service.processes.adjust.named_network import unit_of

MOST_LISTED = 100_000
"""Larger networks list only removed and suspicious observations in the document."""
MOST_OBJECTS = 3000
MOST_CORRELATIONS = 200
CORRELATED = 0.9
POINTS_OF_FORM = 10


def observation_columns(answer: Answer, alpha: float, power: float) -> dict[str, list[Any]]:
    """Give all components of all observations, field by field of `ObservationDocument`."""
    named, tests, found = answer.named, answer.tests, answer.estimate
    network, rows = named.network, named.rows
    blocks = network.block_of_row
    used = found.weights > 0.0
    kinds = dict.fromkeys(zip(rows.types, rows.components, strict=True))
    known = {(kind, component): (1.0, "px") if kind == "image" else unit_of(component) for kind, component in kinds}
    units = [known[each] for each in zip(rows.types, rows.components, strict=True)]
    if any(kind == "unknowns" for kind, _ in kinds):
        units = [
            _unit_of_unknown(*each, answer)
            for each in zip(rows.types, rows.stations, rows.components, units, strict=True)
        ]
    factors = np.array([factor for factor, _ in units])
    stds = network.stds * answer.cleaned.scales[blocks]
    left = np.where(used, tests.redundancy, 1.0)
    seen, sigma0 = tests.controlled, found.sigma0
    # of correlated components single redundancy numbers may be negative
    positive = left > 0.0
    effects = noncentrality(alpha, power) * np.sqrt(np.maximum(1.0 - left, 0.0) / np.where(positive, left, 1.0))
    shifts = _effects_on_points(answer)
    reinstated = np.zeros(len(network.sizes), dtype=bool)
    reinstated[answer.cleaned.reinstated] = True
    reinstated &= answer.cleaned.used
    states = np.select(
        [~used, named.fictitious[blocks], ~seen, reinstated[blocks]],
        ["removed", "fictitious", "not-controlled", "reinstated"],
        "used",
    )
    tested = tests.degrees[blocks] > 0
    group_names = np.array(named.group_names, dtype=object)
    return {
        "type": list(rows.types), "station": list(rows.stations), "scan": list(rows.scans), "point": list(rows.points),
        "component": list(rows.components), "group": group_names[named.groups[blocks]].tolist(),
        "unit": [unit for _, unit in units],
        "residual": (found.linearised.raw_residuals * factors).tolist(), "std": (stds * factors).tolist(),
        "residual_std": _where(seen & used, stds * np.sqrt(np.maximum(left, 0.0)) * factors),
        "redundancy": tests.redundancy.tolist(), "w": _where(seen, tests.w),
        "tau": _where(seen & bool(sigma0), tests.w / (sigma0 or 1.0)),
        "statistic": _where(tested, tests.statistics[blocks]), "p_value": _where(tested, tests.p_values[blocks]),
        "mdb": _where(seen, tests.detectable * factors), "mdb_in_std": _where(seen, tests.detectable / stds),
        "external_effect": _where(seen & used & positive, effects),
        "point_effect_m": _where(np.isfinite(shifts), shifts),
        "state": states.tolist(),
    }  # fmt: skip


def _where(there: Array, values: Array) -> list[float | None]:
    """Give values (n,), None where there are none."""
    found: list[float | None] = values.tolist()
    for k in np.flatnonzero(~there).tolist():
        found[k] = None
    return found


def _unit_of_unknown(
    kind: str, owner: str | None, component: str, unit: tuple[float, str], answer: Answer
) -> tuple[float, str]:
    """Camera parameters are pixels or have no unit of length."""
    if kind == "unknowns" and owner in answer.named.names[Kind.CAMERA]:
        return 1.0, "px" if component in {"c", "x0", "y0"} else "1"
    return unit


def listed_observations(columns: dict[str, list[Any]], critical: float) -> list[ObservationDocument]:
    """Choose what the document lists: everything, or what matters of a very large network."""
    count = len(columns["type"])
    chosen: Sequence[int] = range(count)
    if count > MOST_LISTED:
        pairs = zip(columns["state"], columns["w"], strict=True)
        chosen = [k for k, (state, w) in enumerate(pairs) if state == "removed" or abs(w or 0.0) > critical]
    names = list(columns)
    return [ObservationDocument.model_construct(**{name: columns[name][k] for name in names}) for k in chosen]


def _effects_on_points(answer: Answer) -> Array:
    """Give how far an undetected error of the smallest detectable size moves its own point; NaN where it has none."""
    named, tests = answer.named, answer.tests
    network = named.network
    points = network.layout.columns[Kind.POINT]
    effects = np.full(len(named.rows), np.nan)
    for k, each in enumerate(network.observations):
        if each.size != 1:
            continue
        numbers = [numbers for kind, numbers in each.places if kind is Kind.POINT]
        if not numbers:
            continue
        rows = network.first_rows[network.first_blocks[k]] + np.arange(len(each))
        targets = points[numbers[-1]]
        good = tests.controlled[rows] & (answer.estimate.weights[rows] > 0.0) & answer.determined(targets)
        if not good.any():
            continue
        rows, targets = rows[good], targets[good]
        stds = network.stds[rows]
        errors = tests.detectable[rows] / stds
        effects[rows] = np.linalg.norm(
            effects_on_points(answer.estimate, answer.cofactors, rows, targets, errors), axis=1
        )
    return effects


def removal_documents(answer: Answer) -> list[RemovalDocument]:
    """Describe what was left out, in order."""
    network, rows, tests = answer.named.network, answer.named.rows, answer.tests
    found = []
    for removal in answer.cleaned.removals:
        k = int(network.first_rows[removal.block])
        several = network.sizes[removal.block] > 1
        w = float(tests.w[k]) if tests.controlled[k] and not several else None
        found.append(
            RemovalDocument(
                station=rows.stations[k],
                scan=rows.scans[k],
                point=rows.points[k],
                component="all" if several else rows.components[k],
                stage=removal.stage,
                step=removal.step,
                statistic=removal.statistic,
                w=w,
            )
        )
    return found


def object_documents(answer: Answer, alpha: float) -> list[ObjectTestDocument]:
    """Test points, scans and photos as a whole, the worst first."""
    named = answer.named
    used = answer.estimate.weights > 0.0
    scales = answer.cleaned.scales[named.network.block_of_row]
    objects = [(kind, name, rows[used[rows]]) for kind, name, rows in named.objects()]
    if len(objects) > MOST_OBJECTS:
        objects = [each for each in objects if each[0] != "point"][:MOST_OBJECTS]
    found = []
    for kind, name, rows in objects:
        test = object_test(answer.estimate, rows, scales)
        if test is not None:
            found.append(
                ObjectTestDocument(
                    kind=kind,
                    name=name,
                    observations=len(rows),
                    statistic=test.statistic,
                    degrees_of_freedom=test.degrees_of_freedom,
                    p_value=test.p_value,
                    suspicious=test.p_value < alpha / max(len(objects), 1),
                )
            )
    return sorted(found, key=lambda each: (each.p_value, -each.statistic))


def fictitious_documents(answer: Answer) -> list[FictitiousDocument]:
    """Name the unknowns that nothing determined."""
    found, factor = answer.estimate, answer.estimate.factor
    documents = []
    for column in found.fictitious:
        right = np.zeros(len(factor.scale))
        right[column] = 1.0
        direction = np.abs(factor.solved(right) / factor.scale)
        others = [int(k) for k in np.argsort(-direction)[:20] if direction[k] > 0.01 * direction.max()]
        name = answer.named.unknown_name(int(column))
        documents.append(
            FictitiousDocument(
                unknown=name,
                undetermined=[answer.named.unknown_name(k) for k in others],
                advice="observe it from another station or photo, hold it, or give an expected value with its std",
            )
        )
    return documents


def correlation_documents(answer: Answer) -> list[CorrelationDocument]:
    """List unknowns that can hardly be told apart."""
    first, second, values = high_correlations(answer.cofactors, ~answer.undetermined, CORRELATED, MOST_CORRELATIONS)
    return [
        CorrelationDocument(
            first=answer.named.unknown_name(int(a)), second=answer.named.unknown_name(int(b)), correlation=float(value)
        )
        for a, b, value in zip(first, second, values, strict=True)
    ]


def form_documents(answer: Answer) -> list[WeakFormDocument]:
    """Describe the weakest forms of the points."""
    named = answer.named
    columns = named.network.layout.columns[Kind.POINT]
    number, place = np.nonzero((columns >= 0) & answer.determined(columns)[:, None])
    chosen = columns[number, place]
    forms = weakest_forms(answer.cofactors, chosen)
    if not len(forms.variances):
        return []
    trace = float(answer.cofactors.elements(chosen, chosen).sum())
    found = []
    for variance, vector in zip(forms.variances, forms.vectors.T, strict=True):
        moves = np.zeros((len(named.points), 3))
        moves[number, place] = vector
        order = np.argsort(-np.linalg.norm(moves, axis=1))[:POINTS_OF_FORM]
        found.append(
            WeakFormDocument(
                std_m=float(np.sqrt(max(variance, 0.0) * answer.scale)),
                share=float(variance / trace) if trace else 0.0,
                points=[{"id": named.points[k], "direction": moves[k].tolist()} for k in order],
            )
        )
    return found


def check_documents(answer: Answer) -> list[CheckDocument]:
    """Compare adjusted points with known ones that took no part."""
    named = answer.named
    columns = named.network.layout.columns[Kind.POINT]
    found = []
    for name, known in named.checks.items():
        if name not in named.points:
            continue
        k = named.points.index(name)
        miss = known - answer.state.points[k] - named.origin_m
        statistic = p_value = None
        if answer.determined(columns[k : k + 1])[0] and (columns[k] >= 0).all():
            covariance = answer.covariances(columns[k : k + 1])[0]
            statistic = float(miss @ np.linalg.lstsq(covariance, miss, rcond=None)[0])
            p_value = float(chi2_sf(statistic, 3))
        found.append(CheckDocument(id=name, miss_m=vector_of(miss), statistic=statistic, p_value=p_value))
    return found
