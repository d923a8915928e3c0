"""Whole, small texts of every kind that a request may hold: what hostile ones are made from."""

import json
from collections.abc import Mapping
from typing import Any

GAMA = """<?xml version="1.0"?>
<gama-local xmlns="http://www.gnu.org/software/gama/gama-local"><network axes-xy="ne" angles="left-handed">
<points-observations distance-stdev="2" direction-stdev="10" zenith-angle-stdev="10">
<point id="A" x="0" y="0" z="0" fix="xyz"/><point id="B" x="10" y="0" z="1" fix="xyz"/><point id="P" adj="xyz"/>
<obs from="A"><direction to="B" val="0"/><direction to="P" val="50"/><z-angle to="P" val="99"/>
<s-distance to="P" val="7.1"/></obs>
<height-differences><dh from="A" to="P" val="0.1" stdev="1"/></height-differences>
<vectors><vec from="B" to="P" dx="-5" dy="5" dz="-0.9"/><cov-mat dim="3" band="2">4 1 0 4 0 9</cov-mat></vectors>
</points-observations></network></gama-local>"""
TURNED = "0.0 -1.0 0.0 4.0 1.0 0.0 0.0 5.0 0.0 0.0 1.0 6.0 0.0 0.0 0.0 1.0"
TIE_POINTS = "".join(
    f"<tiepoint name='T{n}'><x>{x}</x><y>{y}</y><z>{z}</z></tiepoint>"
    for n, (x, y, z) in enumerate([(1.0, 2.0, 3.0), (-4.0, 1.0, 0.5), (2.0, -6.0, 1.0), (0.0, 3.0, -2.0)])
)
OF_LENS = {
    "fx": 3001,
    "fy": 3000,
    "cx": 1500,
    "cy": 1000,
    "k1": -0.1,
    "k2": 0.1,
    "k3": 0,
    "k4": 0,
    "p1": 0.001,
    "p2": 0,
}
LENS = "".join(f"<{name}>{value}</{name}>" for name, value in OF_LENS.items())
PHOTO = (
    f"<scanposimages><scanposimage name='I'><cop><matrix>{TURNED}</matrix></cop>"
    "<camcalib_ref noderef='/project/calibrations/camcalibs/D70'/>"
    "<mountcalib_ref noderef='/project/calibrations/mountcalibs/M'/></scanposimage></scanposimages>"
)
RISCAN = (
    "<?xml version='1.0'?><project name='p'><calibrations><camcalibs><camcalib_opencv name='D70'>"
    f"<internal_opencv>{LENS}</internal_opencv></camcalib_opencv></camcalibs><mountcalibs><mountcalib name='M'>"
    f"<matrix>{TURNED}</matrix></mountcalib></mountcalibs></calibrations><scanpositions>"
    + "".join(
        f"<scanposition name='S{k}'><sop><matrix>{TURNED}</matrix></sop>{PHOTO if k == 1 else ''}"
        f"<tiepoints>{TIE_POINTS}</tiepoints></scanposition>"
        for k in (1, 2)
    )
    + "</scanpositions></project>"
)
JAG3D = {
    "reference-points": "A 0 0 0\nB 100 0 0 # held\nC 100 100 0\n",
    "new-points": "P 40 60 1\n",
    "directions": "A B 100.0 0.001\nA P 37.4334 0.001\nA P 237.4334 0.001\n",
    "zenith-angles": "A P 1.5 1.6 99.1172 0.001\nA P 1.5 1.6 300.8828 0.001\n",
    "slope-distances": "A P 72.118 0.003\nB P 84.858 0.003\nC P 72.118 0.003\n",
    "height-differences": "A P 1.0 0.001\n",
}
TABLE = "name;x [m];y [m];z [m];s_x [mm];s_y [mm];s_z [mm]\n" + "".join(
    f"K{n};{700000 + 7 * n},125;{5300000 - 3 * n},5;{400 + n},25;2;2;3\n" for n in range(12)
)
FLIGHT = "time,x,y,z,roll,pitch,heading\n" + "".join(f"{t}.5,{3 * t},{2 * t},500,0.1,-0.2,45.0\n" for t in range(40))


def whole_texts() -> Mapping[str, bytes]:
    """Give a text of each kind, by a name that tells the kind before its dot."""
    return {
        "gama.xml": GAMA.encode(),
        "riscan.xml": RISCAN.encode(),
        **{f"jag3d.{kind}": text.encode() for kind, text in JAG3D.items()},
        "table.csv": TABLE.encode(),
        "flight.csv": FLIGHT.encode(),
    }


def request_with(name: str, text: str) -> tuple[str, bytes]:
    """Give the process and the body of a request that holds a text in place of the whole one of its name."""
    kind, _, part = name.partition(".")
    network: dict[str, Any]
    if kind == "table":
        stations = [{"name": each, "scan": {"file": each}} for each in ("a", "b")]
        return "register", json.dumps({"inputs": {"stations": stations, "control": {"csv": text}}}).encode()
    if kind == "jag3d":
        files = [{"type": each, "text": text if each == part else whole} for each, whole in JAG3D.items()]
        network = {"format": "jag3d", "files": files}
    else:
        network = {"format": {"gama": "gama-local", "riscan": "riscan-project"}[kind], "xml": text}
    return "adjust", json.dumps({"inputs": {"network": network}}).encode()
