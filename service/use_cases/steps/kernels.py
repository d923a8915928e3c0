"""The compiled kernels of the numerics: compiled once on a machine, by one process, and everybody knows what it waits
for.

Numba keeps what it compiled beside the program, or where ``NUMBA_CACHE_DIR`` says. A mark beside it tells that the
kernels of a registration are all there; until it is, one process compiles by registering two scans of a tiny room, and
others wait for it and tell how far it is, for to compile the same in each of them would take each as long. So do the
other parts, each for itself: who fits a terrain does not wait for what only registrations need.
"""

import fcntl
import hashlib
import importlib
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

from service.ports import StepProgress
from service.use_cases.steps.compile_ahead import compile_ahead, load_listed
from service.use_cases.steps.practice import (
    practise,
    practise_on_clouds,
    practise_on_edges,
    practise_on_methods,
    practise_on_networks,
    practise_on_photos,
    practise_on_strips,
    practise_on_terrain,
    practise_on_triangles,
)

COMPILING = "compiling the numerical kernels (once on this machine, about a minute)"
LOOK_S = 0.5
KERNELS = Path(__file__).parents[3] / "algorithms"
SCANS, METHODS, CLOUDS, NETWORKS = "scans", "methods", "clouds", "networks"
TERRAIN, STRIPS = "terrain", "strips"
TRIANGLES = "triangles"
EDGES_OF_PHOTOS, LINES_OF_PHOTOS = "edges", "photos"
PRACTICES = {
    SCANS: practise,
    METHODS: practise_on_methods,
    CLOUDS: practise_on_clouds,
    EDGES_OF_PHOTOS: practise_on_edges,
    LINES_OF_PHOTOS: practise_on_photos,
    NETWORKS: practise_on_networks,
    TERRAIN: practise_on_terrain,
    STRIPS: practise_on_strips,
    TRIANGLES: practise_on_triangles,
}


def ensure_compiled(progress: StepProgress, part: str = SCANS) -> None:
    """Return when the kernels of a part are compiled; compile them where nobody has done so, and nobody does."""
    folder = kept_in()
    if folder is not None:
        compile_once(folder, partial(_compile_part, part), counted_kernels, progress, part)


def _compile_part(part: str) -> None:
    """Practise, after several processes have compiled what practice calls, where everybody waits for it."""
    if part == SCANS:
        compile_ahead()
    PRACTICES[part]()


def compile_kernels() -> None:
    """Compile all kernels unless they are."""
    compile_common_kernels()
    compile_other_kernels()


def compile_common_kernels() -> None:
    """Compile the kernels that most computations need, unless they are, and see whether they can be loaded."""
    ensure_compiled(_Silence())
    load_common_kernels()


def compile_other_kernels() -> None:
    """Compile the kernels of all other parts unless they are."""
    for part in PRACTICES:
        ensure_compiled(_Silence(), part)


def load_common_kernels() -> None:
    """Load the kernels that most computations need; to practise would take three times as long."""
    load_listed()


def import_kernels() -> None:
    """Import all modules with kernels, which look whether they could keep what is compiled."""
    for path in sorted(KERNELS.rglob("*_kernels.py")):
        importlib.import_module(".".join((KERNELS.name, *path.relative_to(KERNELS).with_suffix("").parts)))


def keep_kernels_as_they_are() -> None:
    """Load kernels in this process from now on, and compile those that are missing, but keep none for others."""
    from numba.core.caching import Cache

    def forget(_cache: Cache, _signature: Any, _compiled: Any) -> None:
        """Do not write to where kernels are kept."""

    Cache.save_overload = forget  # type: ignore[method-assign]


def compile_once(
    folder: Path,
    compile_all: Callable[[], None],
    counted: Callable[[Callable[[], None]], Any],
    progress: StepProgress,
    part: str = SCANS,
) -> None:
    """Let one process compile, whoever else wants it.

    Parameters
    ----------
    folder
        Where the compiled kernels are kept; the mark and the lock are put there as well.
    compile_all
        Compiles.
    counted
        Makes the context in which it is told of each kernel that is compiled, by several processes at once.
    progress
        Hears that, and how far, something is compiled.
    part
        Names what is compiled.
    """
    mark, told = folder / f"tieline-{part}-{_fingerprint()}.compiled", folder / f"tieline-compiling-{part}"
    if mark.exists():
        return
    with told.with_suffix(".lock").open("w") as lock:
        while not _locked(lock.fileno()):
            with suppress(OSError):
                progress.report(0.0, _so_far(told))
            time.sleep(LOOK_S)
        if mark.exists():
            return

        def tell() -> None:
            with told.open("ab") as file:  # several processes add to it, and it is as long as what they have compiled
                file.write(b".")
            progress.report(0.0, _so_far(told))

        told.write_bytes(b"")
        progress.report(0.0, _so_far(told))
        with counted(tell):
            compile_all()
        told.unlink(missing_ok=True)
        mark.touch()


def kept_in() -> Path | None:
    """Give the folder in which numba keeps compiled kernels, None where it keeps none."""
    from algorithms.matching import line_pairs_kernels

    with suppress(AttributeError, OSError):
        kernel: Any = line_pairs_kernels.alike_rows
        folder = Path(kernel._cache.cache_path)  # noqa: SLF001 - told in no other way
        folder.mkdir(parents=True, exist_ok=True)
        for part in PRACTICES:
            (folder / f"tieline-compiling-{part}.lock").touch()
        return folder
    return None


@contextmanager
def counted_kernels(tell: Callable[[], None]) -> Iterator[None]:
    """Tell of each kernel when it has been compiled."""
    from numba.core import event

    class Count(event.Listener):
        def on_start(self, event: Any) -> None:
            """Take no notice."""

        def on_end(self, event: Any) -> None:  # noqa: ARG002 - the library's signature
            """Tell."""
            tell()

    with event.install_listener("numba:compile", Count()):
        yield


def _so_far(told: Path) -> str:
    return f"{COMPILING}: {told.stat().st_size} done"


def _locked(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _fingerprint() -> str:
    """Name what was compiled: with another numba, or other kernels, it is compiled anew."""
    import numba

    files = sorted(KERNELS.rglob("*_kernels.py"))
    parts = [numba.__version__, *(f"{path.name} {path.stat().st_mtime_ns} {path.stat().st_size}" for path in files)]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]


class _Silence:
    """Nobody listens."""

    def report(self, fraction: float, message: str) -> None:
        """Take no notice."""
