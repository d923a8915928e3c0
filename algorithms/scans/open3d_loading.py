"""The one place that imports open3d."""

import ctypes
import sys
from functools import cache
from importlib import import_module
from types import ModuleType

NOTEBOOK_VIEWER = "open3d.visualization.draw_plotly"
NAMES_OF_VIEWER = ("get_plotly_fig", "draw_plotly", "draw_plotly_server")


@cache
def import_open3d() -> ModuleType:
    """Import open3d where the machine has no libusb of its own.

    The open3d wheel links against ``libusb-1.0.so.0`` for depth cameras and does not bring it, so on a bare Linux
    machine ``import open3d`` fails although nothing here touches a camera. The library of the package
    ``libusb-package`` carries the same soname: loaded first and for everybody, it satisfies the linker.

    Importing open3d also imports its viewer for notebooks, with dash, plotly, flask and hundreds of modules more, with
    which nothing is shown here and which `pyproject.toml` leaves out: an empty module stands in its place.

    Returns
    -------
    The module ``open3d``; the first call takes a third of a second, later ones nothing.

    Raises
    ------
    ImportError
        When open3d is not installed.
    """
    if sys.platform == "linux":
        path = import_module("libusb_package").get_library_path()
        if path is not None:
            ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
    if NOTEBOOK_VIEWER not in sys.modules:
        viewer = ModuleType(NOTEBOOK_VIEWER, "Left out.")
        viewer.__dict__.update(dict.fromkeys(NAMES_OF_VIEWER))
        sys.modules[NOTEBOOK_VIEWER] = viewer
    return import_module("open3d")
