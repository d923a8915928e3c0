"""What a verdict by the evidence is worth, as a page: what it accepts beside the rules in force, how sure it may be."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from algorithms.arrays import Array, Flags, Scalars
from algorithms.evidence.calibration import Calibration
from algorithms.evidence.log_odds import log_odds
from algorithms.registration.verdict import LEAST_PROBABILITY
from tests.calibration.frozen import ARCHIVE, Frozen
from tests.calibration.pairs import Pairs

REAL = ARCHIVE.with_name("real_scans.npz")
"""Pairs of the open data sets, frozen likewise."""
RISK = 0.005
"""A pose is accepted by the evidence if it is wrong with no more than this probability."""
COMMON = ((0.3, 1.01), (0.16, 0.3), (0.1, 0.16), (0.05, 0.1), (0.0, 0.05))
SAID = (0.0, 0.5, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 1.01)
TERMS = ("free_space", "beside", "pieces", "determined", "ahead", "usual", "chosen")
HEAD = """# How reliable the probability of a place is

Written by `python -m tests.calibration.fit --write` from the frozen pairs of simulated scans in `tests/calibration`.
The model is `log_odds.py` beside this page (MATH 5.10). Every kind of building is judged by constants that were fitted
on the other kinds. "Evidence" accepts what is the right place with a probability of at least {least} and precise
enough. "Rules" decide the status; "in force" is what they accept less what the evidence calls rather not the right
place (below one half).

Of {pairs} pairs {accepted} are probable enough, {wrong} of them wrong: at 95 % no more than {bound:.2%} are. No
probability above {most:.4f} is said.
"""


def reliability(pairs: Pairs, probability: Scalars, right: Flags, calibration: Calibration) -> str:
    """Write the page.

    Parameters
    ----------
    pairs
        All frozen pairs.
    probability, right
        (n,) of the best pose of each pair, and whether it is right.
    calibration
        The constants fitted on all, with what was accepted and wrong.
    """
    parts = [
        HEAD.format(
            least=1.0 - RISK,
            pairs=calibration.pairs,
            accepted=calibration.accepted,
            wrong=calibration.wrong,
            bound=calibration.upper_95,
            most=1.0 - calibration.upper_95,
        ),
        *_acceptance(pairs, probability, right),
        "## Said and true\n\n| said | pairs | mean of what was said | of them right |\n|---|---|---|---|",
        *_said(probability, right),
        "",
        *_of_real_scans(calibration),
        *_walks(pairs, calibration),
    ]
    return "\n".join(parts).rstrip() + "\n"


def _acceptance(pairs: Pairs, probability: Scalars, right: Flags) -> Iterator[str]:
    ours = (probability >= 1.0 - RISK) & pairs.of_pairs("precise")
    rules, rules_right = pairs.of_pairs("status") == "accepted", pairs.of_pairs("status_right")
    probable = probability >= LEAST_PROBABILITY
    same, common = pairs.of_pairs("same_place"), pairs.of_pairs("common")
    families, buildings = pairs.of_pairs("family"), pairs.of_pairs("building")
    groups = {
        "common surface": [
            *((f"{low:.0%} to {min(high, 1):.0%}", same & (common >= low) & (common < high)) for low, high in COMMON),
            ("two places", ~same),
            ("all", same | ~same),
        ],
        "why drawn": [(str(name), families == name) for name in np.unique(families)],
        "building": [(str(name), buildings == name) for name in np.unique(buildings) if "/" not in name],
    }
    yield "## What is accepted\n"
    for title, classes in groups.items():
        yield f"| {title} | pairs | evidence: right | wrong | rules: right | wrong | in force: right | wrong |"
        yield f"|{'---|' * 8}"
        for name, chosen in classes:
            verdicts = ((ours, right), (rules, rules_right), (rules & probable, rules_right))
            sides = [flags for accepted, is_right in verdicts for flags in (accepted & is_right, accepted & ~is_right)]
            counts = [int(chosen.sum()), *(int((chosen & flags).sum()) for flags in sides)]
            yield f"| {name.replace('_', ' ')} | {' | '.join(map(str, counts))} |"
        yield ""


def _said(probability: Scalars, right: Flags) -> Iterator[str]:
    for low, high in pairwise(SAID):
        chosen = (probability >= low) & (probability < high)
        if chosen.any():
            said, true = probability[chosen].mean(), right[chosen].mean()
            yield f"| {low} to {min(high, 1.0)} | {chosen.sum()} | {said:.4f} | {true:.4f} |"


def _of_real_scans(calibration: Calibration) -> Iterator[str]:
    """Weigh pairs of real scans, of which none is ever fitted."""
    pairs = Pairs(Frozen.read(REAL).arrays)
    poses, _, best = pairs.probabilities(calibration.weights)
    right, status_right = pairs.frozen["right"][best], pairs.of_pairs("status_right")
    sure, rules = poses[best] >= 1.0 - RISK, pairs.of_pairs("status") == "accepted"
    yield "## Real scans, never fitted\n"
    yield "| set | pairs | evidence: right | wrong | rules: right | wrong | least probability of those |"
    yield f"|{'---|' * 7}"
    for name in np.unique(pairs.of_pairs("family")):
        chosen = pairs.of_pairs("family") == name
        sides = (sure & right, sure & ~right, rules & status_right, rules & ~status_right)
        counts = [int(chosen.sum()), *(int((chosen & flags).sum()) for flags in sides)]
        least = f"{poses[best][chosen & rules].min():.2f}" if (chosen & rules).any() else "–"
        yield f"| {name.removeprefix('real_')} | {' | '.join(map(str, counts))} | {least} |"
    yield ""


def _walks(pairs: Pairs, calibration: Calibration) -> Iterator[str]:
    """Walk through one pair that is accepted, one that is ambiguous and one that is refused, number by number."""
    poses, none, best = pairs.probabilities(calibration.weights)
    parts, counts = log_odds(pairs.counts, calibration.weights), pairs.counts
    wanted = {
        "accepted": poses[best] >= 1.0 - RISK,
        "ambiguous": (poses[best] < 0.6) & (none < 0.1),
        "refused": none > 0.95,
    }
    yield "## Three pairs, number by number\n"
    yield f"| | {' | '.join(wanted)} |\n|---|---|---|---|"
    chosen = [int(np.flatnonzero(flags)[flags.sum() // 2]) for flags in wanted.values()]
    rows = [int(best[k]) for k in chosen]

    def row(title: str, values: Array, form: str) -> str:
        return f"| {title} | {' | '.join(format(value, form) for value in values)} |"

    kinds = pairs.of_pairs("building")
    yield f"| building | {' | '.join(str(kinds[k]).replace('_', ' ') for k in chosen)} |"
    yield row("patches that fit", counts.fits[rows], ".0f")
    yield row("of how many pieces, full ones as one", counts.fitting[rows], ".1f")
    yield row("patches that were looked through", counts.through[rows], ".1f")
    yield row("patches beside parallel surface", counts.beside[rows], ".1f")
    yield row("pieces that cannot be where they are", counts.against[rows], ".0f")
    for term in TERMS:
        yield row(f"log-odds: {term.replace('_', ' ')}", getattr(parts, term)[rows], "+.1f")
    yield row("sum", parts.total[rows], "+.1f")
    yield row("probability", poses[rows], ".4f")
    yield row("of the next pose", np.array([_second(pairs, poses, k) for k in chosen]), ".4f")
    yield row("of none of them", none[chosen], ".4f")


def _second(pairs: Pairs, poses: Scalars, number: int) -> float:
    own = np.sort(poses[pairs.pair == number])
    return float(own[-2]) if len(own) > 1 else 0.0
