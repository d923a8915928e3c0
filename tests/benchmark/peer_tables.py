"""Tables of what methods reached on the same pairs."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from peer_methods import Answer
from peer_sets import PeerPair

BANDS = ((0.30, 1.01), (0.10, 0.30), (0.0, 0.10))
"""Of the overlap."""
OURS = "tieline"


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one method said of one pair, beside the truth."""

    method: str
    pair: PeerPair
    answer: Answer | None
    """None: the method's process ended before it answered."""
    errors: tuple[float, float] | None
    """Rotation [degree] and translation [m]; None where there is no pose."""
    within: bool
    """Whether they are within the tolerances."""
    peak_mb: float

    @property
    def good(self):
        """Whether the method itself finds nothing wrong with its pose."""
        return self.answer is not None and self.errors is not None and self.answer.good

    @property
    def right(self):
        return self.within and self.good

    @property
    def wrong(self):
        return self.errors is not None and not self.within

    @property
    def wrong_and_good(self):
        return self.wrong and self.good

    @property
    def mark(self):
        """R right, r right but not called good, X wrong and called good, x wrong, - no pose."""
        if self.errors is None:
            return "-"
        return ("R" if self.good else "r") if self.within else ("X" if self.good else "x")


def pair_table(outcomes: Sequence[Outcome]) -> Iterable[str]:
    """Give a line for each pair."""
    yield "R right, r right but not called good, X wrong and called good, x wrong, - no pose; rotation deg / mm, CPU s"
    methods = list(dict.fromkeys(outcome.method for outcome in outcomes))
    yield f"{'pair':24s} overlap " + " ".join(f"{method:>28s}" for method in methods)
    for pair in dict.fromkeys(outcome.pair for outcome in outcomes):
        cells = []
        for outcome in (outcome for outcome in outcomes if outcome.pair is pair):
            if outcome.errors is None or outcome.answer is None:
                cells.append(f"{outcome.mark:>28s}")
                continue
            rotation, translation = outcome.errors
            cells.append(f"{outcome.mark} {rotation:8.4f} /{1e3 * translation:8.1f} {outcome.answer.cpu_s:6.1f}s")
        yield f"{pair.name:24s} {pair.overlap:7.2f} " + " ".join(f"{cell:>28s}" for cell in cells)


def method_table(outcomes: Sequence[Outcome]) -> Iterable[str]:
    """Give a line for each method: answers, errors of the right ones, time and memory."""
    bands = [f"{low:.2f}+" for low, _ in BANDS]
    yield (
        f"{'method':14s} {'right':>8s} {' '.join(f'{band:>7s}' for band in bands)} unsure wrong and-good none "
        "| med deg  med mm | med wall  med CPU  3 sizes CPU  peak MB"
    )
    for method in dict.fromkeys(outcome.method for outcome in outcomes):
        own = [outcome for outcome in outcomes if outcome.method == method]
        right = [outcome for outcome in own if outcome.right]
        shares = [_share([o for o in own if low <= o.pair.overlap < high]) for low, high in BANDS]
        errors = np.array([outcome.errors for outcome in right]).reshape(-1, 2)
        rotation, translation = np.median(errors, axis=0) if right else (np.nan, np.nan)
        yield (
            f"{method:14s} {_share(own):>8s} {' '.join(f'{share:>7s}' for share in shares)} "
            f"{sum(o.within and not o.good for o in own):6d} {sum(o.wrong for o in own):5d} "
            f"{sum(o.wrong_and_good for o in own):8d} {sum(o.errors is None for o in own):4d} "
            f"| {rotation:7.4f} {1e3 * translation:7.1f} "
            f"| {_median(own, 'wall_s'):8.2f} {_median(own, 'cpu_s'):8.2f} {_median(own, 'all_cpu_s'):12.2f} "
            f"{max(o.peak_mb for o in own):8.0f}"
        )


def ratio_table(outcomes: Sequence[Outcome]) -> Iterable[str]:
    """Give ratios of Tieline to each peer, the best one marked: errors where both are right, times over all pairs."""
    own = [outcome for outcome in outcomes if outcome.method == OURS]
    peers = [m for m in dict.fromkeys(o.method for o in outcomes) if m != OURS]
    if not own or not peers:
        return
    best = max(peers, key=lambda m: _rank([o for o in outcomes if o.method == m]))
    for method in peers:
        theirs = [outcome for outcome in outcomes if outcome.method == method]
        both = [(a.errors, b.errors) for a, b in zip(own, theirs, strict=True) if a.right and b.right]
        words = "no pair where both are right"
        if both:
            ours, peer = (np.median(np.array(side, dtype=np.float64), axis=0) for side in zip(*both, strict=True))
            words = (
                f"rotation error x {ours[0] / peer[0]:.2f}, translation error x {ours[1] / peer[1]:.2f} "
                f"({len(both)} pairs where both are right)"
            )
        times = [f"{name} x {_median(own, key) / _median(theirs, key):.2f}" for name, key in TIMES.items()]
        yield f"Tieline to {method}{' (best peer)' if method == best else ''}: {words}; {', '.join(times)}"


TIMES = {"wall": "wall_s", "CPU": "cpu_s", "CPU with all three sizes": "all_cpu_s"}


def _rank(outcomes: Sequence[Outcome]) -> tuple[int, float]:
    """Rank a peer by right answers, then by small errors."""
    right = [outcome.errors[1] for outcome in outcomes if outcome.right and outcome.errors is not None]
    return len(right), -float(np.median(right)) if right else -np.inf


def _share(outcomes: Sequence[Outcome]) -> str:
    return f"{sum(outcome.right for outcome in outcomes)}/{len(outcomes)}"


def _median(outcomes: Sequence[Outcome], name: str) -> float:
    values = [getattr(outcome.answer, name) for outcome in outcomes if outcome.answer is not None]
    return float(np.median(values)) if values else float("nan")
