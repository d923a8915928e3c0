"""Scan to scan: every method in a file of its own, all of them in one union."""

from algorithms.registration.auto import AutoMethod
from algorithms.registration.egi import EgiMethod
from algorithms.registration.icl import IclMethod
from algorithms.registration.icp_d2 import IcpD2Method
from algorithms.registration.icp_plane import IcpPlaneMethod
from algorithms.registration.icp_point import IcpPointMethod
from algorithms.registration.lines import LinesMethod
from algorithms.registration.lines_alshawa import LinesAlshawaMethod
from algorithms.registration.lines_compat import LinesCompatMethod
from algorithms.registration.ndt import NdtMethod
from algorithms.registration.ndt_3d import Ndt3dMethod
from algorithms.registration.planes import PlanesMethod
from algorithms.registration.planes_triples import PlanesTriplesMethod
from algorithms.registration.targets import TargetsMethod

RegistrationMethod = (
    AutoMethod
    | LinesMethod
    | PlanesMethod
    | IcpPlaneMethod
    | LinesCompatMethod
    | LinesAlshawaMethod
    | IclMethod
    | PlanesTriplesMethod
    | NdtMethod
    | Ndt3dMethod
    | EgiMethod
    | IcpPointMethod
    | IcpD2Method
    | TargetsMethod
)
"""All methods, `A | B | ...`; validation, documentation and dispatch follow from it."""

DEFAULT_METHOD = AutoMethod
"""What a request without a method gets."""
