"""What can go wrong in a computation. Each class builds its message from typed arguments."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    # The web process names errors without loading numpy.
    import algorithms.arrays


class AlgorithmError(Exception):
    """Stand for every failure that the mathematics itself reports."""


class InvalidInputError(AlgorithmError):
    """Say that an input cannot be used: which one, why, and what to do."""

    def __init__(self, what: str, why: str, advice: str = "") -> None:
        self.what = what
        self.why = why
        self.advice = advice
        super().__init__(f"{what}: {why}" + (f" ({advice})" if advice else ""))


class MissingLibraryError(AlgorithmError):
    """Say that the machine lacks a library, and which package brings it."""

    def __init__(self, library: str, advice: str) -> None:
        self.library = library
        super().__init__(f"this machine lacks {library}, without which open3d computes nothing: {advice}")


class DegenerateGeometryError(AlgorithmError):
    """Say that the geometry leaves part of the answer free.

    Parameters
    ----------
    rank
        Rank of the normal matrix that the data really support.
    free_directions
        The null space in words, e.g. "translation along (0.00, 0.00, 1.00) of the target frame".
    null_space
        Columns of (rotation vector [rad], translation [m]) that change no observation, shape (6, 6 - rank), or None;
        of a network all unknowns in their order.
    advice
        What the user should add to make it determined.
    parameters
        Number of unknown parameters: the six of a pose, unless said otherwise.
    """

    def __init__(
        self,
        rank: int,
        free_directions: Sequence[str],
        null_space: "algorithms.arrays.Array | None" = None,
        advice: str = "",
        parameters: int = 6,
    ) -> None:
        self.rank = rank
        self.free_directions = tuple(free_directions)
        self.null_space = null_space
        self.advice = advice
        text = "; ".join(free_directions) or "directions could not be named"
        super().__init__(
            f"the geometry determines only {rank} of {parameters} parameters, free: {text}"
            + (f". {advice}" if advice else "")
        )


class TooFewFeaturesError(AlgorithmError):
    """Say that the points of a scan show too little of its surfaces for lines and planes, whatever its geometry is.

    Parameters
    ----------
    kind
        What there is too little of, e.g. "planes".
    points
        Points of the scan.
    which
        What to call the scan, e.g. "target scan".
    why
        What was found, and why more must be there.
    advice
        What the user should do.
    """

    def __init__(self, kind: str, points: int, which: str, why: str, advice: str) -> None:
        self.kind = kind
        self.points = points
        self.which = which
        self.why = why
        self.advice = advice
        super().__init__(f"too few {kind} in {points} points of the {which}: {why}. {advice}")


class TooFewCorrespondencesError(AlgorithmError):
    """Say that fewer corresponding features were found than the answer needs."""

    def __init__(self, found: int, needed: int, kind: str = "lines") -> None:
        self.found = found
        self.needed = needed
        self.kind = kind
        super().__init__(f"found {found} corresponding {kind}, needed at least {needed}")


class NotConvergedError(AlgorithmError):
    """Say that an iteration did not settle."""

    def __init__(self, what: str, iterations: int, last_step: float) -> None:
        self.what = what
        self.iterations = iterations
        self.last_step = last_step
        super().__init__(f"{what} did not converge in {iterations} iterations (last step {last_step:.3g})")


class CancelledError(AlgorithmError):
    """Say that the caller asked to stop."""

    def __init__(self) -> None:
        super().__init__("cancelled on request")
