"""The one place that imports open3d."""

import ctypes
import sys
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

from algorithms.errors import MissingLibraryError

LEFT_OUT = {
    "open3d.visualization.draw_plotly": ("get_plotly_fig", "draw_plotly", "draw_plotly_server"),
    "open3d.ml": (),
}
"""Modules of open3d that nothing here uses, and what others import from them: they load dash, plotly, scikit-learn."""
PACKAGES = {
    "libEGL.so.1": ("libegl1", "libglvnd-egl"),
    "libGL.so.1": ("libgl1", "libglvnd-glx"),
    "libX11.so.6": ("libx11-6", "libX11"),
    "libudev.so.1": ("libudev1", "systemd-libs"),
    "libidn2.so.0": ("libidn2-0", "libidn2"),
    "libstdc++.so.6": ("libstdc++6", "libstdc++"),
}
"""Libraries that the wheel of open3d 0.20 needs and does not bring, with the packages of Debian and of RHEL."""
NOT_INSTALLED = "it has no wheel for this system; `uv run` and `pip install` bring it where there is one"


@cache
def missing_for_open3d() -> MissingLibraryError | None:
    """Return what keeps open3d from being loaded; None: nothing that can be told without loading it.

    The libraries are looked up by the system's own linker, in some milliseconds; open3d itself is not imported.
    """
    if find_spec("open3d") is None:
        return MissingLibraryError("the package open3d", NOT_INSTALLED)
    if sys.platform != "linux":
        return None
    for name, (debian, rhel) in PACKAGES.items():
        try:
            ctypes.CDLL(name)
        except OSError:
            advice = f"install the package {debian} (Debian, Ubuntu) or {rhel} (RHEL, Fedora) and start anew"
            return MissingLibraryError(name, advice)
    return None


@cache
def import_open3d() -> ModuleType:
    """Import open3d where the machine has no libusb of its own.

    The open3d wheel links against ``libusb-1.0.so.0`` for depth cameras and does not bring it, so on a bare Linux
    machine ``import open3d`` fails although nothing here touches a camera. The library of the package
    ``libusb-package`` carries the same soname: loaded first and for everybody, it satisfies the linker.

    Importing open3d also imports its viewer for notebooks, with dash, plotly, flask and hundreds of modules more, with
    which nothing is shown here and which `pyproject.toml` leaves out: an empty module stands in its place, and in that
    of its machine learning.

    Returns
    -------
    The module ``open3d``; the first call takes a third of a second, later ones nothing.

    Raises
    ------
    MissingLibraryError
        open3d is not installed, or a library of the system that it needs is missing.
    """
    missing = missing_for_open3d()
    if missing is not None:
        raise missing
    if sys.platform == "linux":
        path = import_module("libusb_package").get_library_path()
        if path is not None:
            ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
    for name, members in LEFT_OUT.items():
        module = ModuleType(name, "Left out.")
        module.__dict__.update(dict.fromkeys(members))
        sys.modules.setdefault(name, module)
    try:
        return import_module("open3d")
    except ImportError as error:
        raise MissingLibraryError(f"a library ({error})", "install what it names and start the service anew") from error
