"""The one place that imports open3d."""

import ctypes
import mimetypes
import sys
from functools import cache
from importlib import import_module
from types import ModuleType


@cache
def import_open3d() -> ModuleType:
    """Import open3d where the machine has no libusb of its own.

    The open3d wheel links against ``libusb-1.0.so.0`` for depth cameras and does not bring it, so on a bare Linux
    machine ``import open3d`` fails although nothing here touches a camera. The library of the package
    ``libusb-package`` carries the same soname: loaded first and for everybody, it satisfies the linker. dash, which
    open3d loads for its viewer, reads the system's list of media types, which a confined computation may not: there is
    none for it.

    Returns
    -------
    The module ``open3d``; the first call takes about two seconds, later ones nothing.

    Raises
    ------
    ImportError
        When open3d is not installed.
    """
    if sys.platform == "linux":
        path = import_module("libusb_package").get_library_path()
        if path is not None:
            ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
    known, mimetypes.knownfiles = mimetypes.knownfiles, []
    try:
        return import_module("open3d")
    finally:
        mimetypes.knownfiles = known
