"""The simplest explanation of loops that do not close (MATH 6.5)."""

from collections.abc import Sequence
from dataclasses import dataclass

MOST_EXAMINED = 20_000
"""Explanations that are examined for one group of failing loops before the search becomes greedy."""


@dataclass(frozen=True)
class Blame:
    """Why a registration is held to be wrong."""

    alternatives: tuple[int, ...]
    """Registrations that may be the wrong ones instead; empty where the loops leave no choice."""


def wrong_links(failing: Sequence[tuple[int, ...]], passing: Sequence[tuple[int, ...]]) -> dict[int, Blame]:
    """Explain failing loops by as few wrong registrations as possible.

    A set of registrations explains the loops when every failing one holds at least one of them. It costs one for each
    registration, and one for each passing loop of which it blames exactly one: such a loop closed by coincidence.

    Parameters
    ----------
    failing, passing
        Loops as numbers of registrations.

    Returns
    -------
    The blamed ones. Of several explanations of the same least cost all are blamed, each with its alternatives.
    """
    blamed: dict[int, Blame] = {}
    holding: dict[int, list[int]] = {}
    for place, loop in enumerate(passing):
        for number in loop:
            holding.setdefault(number, []).append(place)
    for group in _connected(failing):
        near = sorted({place for number in frozenset().union(*group) for place in holding.get(number, ())})
        search = _Search(group, [passing[place] for place in near])
        best = search.best()
        together = set().union(*best)
        certain = set.intersection(*(set(each) for each in best))
        for number in together:
            others = together - certain - {number}
            blamed[number] = Blame(() if number in certain else tuple(sorted(others)))
    return blamed


def _connected(loops: Sequence[tuple[int, ...]]) -> list[list[frozenset[int]]]:
    """Group loops that share registrations, directly or through others."""
    import networkx as nx

    graph: nx.Graph[int] = nx.Graph()
    for loop in loops:
        nx.add_path(graph, loop)
    group_of = {number: k for k, members in enumerate(nx.connected_components(graph)) for number in members}
    groups: dict[int, list[frozenset[int]]] = {}
    for loop in loops:
        groups.setdefault(group_of[loop[0]], []).append(frozenset(loop))
    return list(groups.values())


class _Search:
    """Branch and bound over the registrations of one group of failing loops."""

    def __init__(self, failing: Sequence[frozenset[int]], passing: Sequence[tuple[int, ...]]) -> None:
        self._failing = list(failing)
        self._passing = [frozenset(loop) for loop in passing]
        self._found: list[frozenset[int]] = []
        self._examined = 0

    def best(self) -> list[frozenset[int]]:
        """Give all explanations of the least cost; one that is merely good where there are too many to examine."""
        greedy = self._greedy()
        self._least, self._found = self._cost(greedy), [greedy]
        self._extend(frozenset(), frozenset())
        if self._examined > MOST_EXAMINED:
            return [greedy]
        return self._found

    def _cost(self, wrong: frozenset[int]) -> int:
        return len(wrong) + sum(len(loop & wrong) == 1 for loop in self._passing)

    def _extend(self, wrong: frozenset[int], innocent: frozenset[int]) -> None:
        """Blame one registration more, of a loop that is not explained yet."""
        self._examined += 1
        if self._examined > MOST_EXAMINED:
            return
        open_loops = [loop - innocent for loop in self._failing if not loop & wrong]
        if not open_loops:
            self._compare(wrong)
            # blaming a second registration of a passing loop takes the coincidence away
            open_loops = [loop - innocent - wrong for loop in self._passing if len(loop & wrong) == 1][:1]
        if not open_loops or len(wrong) + 1 > self._least:
            return
        tried = innocent
        for number in sorted(_smallest(open_loops)):
            self._extend(wrong | {number}, tried)
            tried = tried | {number}

    def _compare(self, wrong: frozenset[int]) -> None:
        cost = self._cost(wrong)
        if cost < self._least:
            self._least, self._found = cost, [wrong]
        elif cost == self._least and wrong not in self._found:
            self._found.append(wrong)

    def _greedy(self) -> frozenset[int]:
        """Blame again and again what most failing and fewest passing loops hold."""
        wrong: frozenset[int] = frozenset()
        while open_loops := [loop for loop in self._failing if not loop & wrong]:
            candidates = sorted(frozenset().union(*open_loops))
            wrong |= {max(candidates, key=lambda k: self._balance(k, open_loops))}
        return wrong

    def _balance(self, number: int, open_loops: Sequence[frozenset[int]]) -> tuple[int, int]:
        breaks = sum(number in loop for loop in open_loops)
        coincidences = sum(number in loop for loop in self._passing)
        return breaks - coincidences, breaks


def _smallest(loops: Sequence[frozenset[int]]) -> frozenset[int]:
    return min(loops, key=lambda loop: (len(loop), sorted(loop)))
