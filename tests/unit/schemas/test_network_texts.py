"""Networks of other programs are read at the door, and hostile or foreign ones refused by name."""

import json
import re
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.progress import NoProgress
from schemas.requests.adjust_inputs import AdjustInputs
from schemas.requests.hybrid_network import HybridNetwork
from service.processes.adjust.adjusting import adjusted_document
from tests.scenes.hostile.hostile_texts import GAMA, RISCAN

BOMB = '<!DOCTYPE a [<!ENTITY b "b"><!ENTITY c "&b;&b;&b;&b;">]><gama-local>&c;</gama-local>'
OUTSIDE = '<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]><gama-local>&x;</gama-local>'


def _network(text: dict[str, Any]) -> HybridNetwork:
    return AdjustInputs.model_validate_json(json.dumps({"network": text}), strict=True).network


def _gama(xml: str) -> HybridNetwork:
    return _network({"format": "gama-local", "xml": xml})


def test_a_network_of_gama_is_read_with_its_axes_and_units_turned() -> None:
    network = _gama(GAMA)
    observed = network.observations
    assert [(c.point, c.held) for c in observed.control] == [("A", True), ("B", True)]
    horizontal = [o for o in observed.polar if o.horizontal is not None]
    assert [(o.point, o.horizontal, o.sigma_horizontal) for o in horizontal] == [("B", 0.0, 1e-3), ("P", -50.0, 1e-3)]
    assert (observed.distances[0].distance, observed.distances[0].sigma) == (7.1, 0.002)
    assert (observed.heights[0].difference, observed.heights[0].sigma) == (0.1, 0.001)
    np.testing.assert_allclose(observed.vectors[0].xyz, [-5.0, -5.0, -0.9])
    assert observed.vectors[0].covariance is not None
    np.testing.assert_allclose(
        np.array(observed.vectors[0].covariance), 1e-6 * np.array([[4, -1, 0], [-1, 4, 0], [0, 0, 9]])
    )


@pytest.mark.parametrize(
    ("xml", "what"),
    [
        (BOMB, "declares entities"),
        (OUTSIDE, "declares entities"),
        ("<gama-local", "no XML"),
        ("<project/>", "no gama-local file"),
        (GAMA.replace('<z-angle to="P" val="99"/>', '<azimuth to="P" val="99"/>'), "'azimuth' is no observation"),
        (
            GAMA.replace('id="B" x="10" y="0" z="1" fix="xyz"', 'id="B" x="10" y="0" fix="xy"'),
            "'B' is fixed in xy only",
        ),
        (GAMA.replace('val="7.1"', 'val="7,1"'), "val of s-distance .to P. is '7,1'"),
        (GAMA.replace(' zenith-angle-stdev="10"', ""), "no zenith-angle-stdev"),
        (GAMA.replace("4 1 0 4 0 9", "4 1 0 4 0 9 9"), "more numbers"),
        (GAMA.replace("<vec ", "<vectors/><vec "), "'vectors' is no observation"),
    ],
)
def test_hostile_and_foreign_files_are_refused_by_name(xml: str, what: str) -> None:
    with pytest.raises(ValidationError, match=what) as caught:
        _gama(xml)
    assert caught.value.errors()[0]["loc"] == ("network",)


def test_what_stands_in_scan_positions_within_each_other_is_not_read_for_each_of_them() -> None:
    xml = RISCAN.replace("</sop>", "</sop><scanposition name='inner'/>", 1)
    with pytest.raises(ValidationError, match="'S1' has another one within it"):
        _network({"format": "riscan-project", "xml": xml})


def _rows(pose: RigidTransform) -> str:
    return " ".join(f"{value:.12f}" for value in pose.as_matrix().ravel())


def test_a_project_of_riscan_gives_poses_photos_and_tie_points() -> None:
    sop = RigidTransform.from_components([10.0, 20.0, 1.0], Rotation.from_euler("XYZ", [0.01, -0.02, 1.0]))
    cop = RigidTransform.from_rotation(Rotation.from_euler("z", 0.5))
    mount = RigidTransform.from_components([0.0, 0.1, 0.2], Rotation.from_euler("XYZ", [-1.5, 0.1, -1.6]))
    xml = f"""<?xml version="1.0"?><!DOCTYPE project SYSTEM "project.dtd"><project name="P"><calibrations><camcalibs>
    <camcalib_opencv name="D70"><internal_opencv><fx>3001</fx><fy>3000</fy><cx>1500</cx><cy>1000</cy><k1>-0.1</k1>
    <k2>0.1</k2><k3>0</k3><k4>0</k4><p1>0.001</p1><p2>0.002</p2></internal_opencv></camcalib_opencv></camcalibs>
    <mountcalibs><mountcalib name="M"><matrix>{_rows(mount)}</matrix></mountcalib></mountcalibs></calibrations>
    <scanpositions><scanposition name="SP1"><sop><matrix>{_rows(sop)}</matrix></sop>
    <scanposimages><scanposimage name="I1"><cop><matrix>{_rows(cop)}</matrix></cop>
    <camcalib_ref noderef="/project/calibrations/camcalibs/D70"/>
    <mountcalib_ref noderef="/project/calibrations/mountcalibs/M"/></scanposimage></scanposimages>
    <tiepoints><tiepoint name="t1"><x>1</x><y>2</y><z>3</z></tiepoint></tiepoints></scanposition></scanpositions>
    </project>"""
    network = _network({"format": "riscan-project", "xml": xml})
    scanner, photo = network.stations
    assert scanner.approx is not None
    assert photo.approx is not None
    np.testing.assert_allclose([scanner.approx.X, scanner.approx.Y, scanner.approx.Z], sop.translation)
    camera_in_world = (sop * cop * mount.inv()).apply([0.0, 0.0, 5.0])
    angles = [photo.approx.omega, photo.approx.phi, photo.approx.kappa]
    rotation = Rotation.from_euler("XYZ", np.array(angles, dtype=np.float64) * np.pi / 200.0)
    place = [photo.approx.X, photo.approx.Y, photo.approx.Z]
    np.testing.assert_allclose(rotation.apply([0.0, 0.0, -5.0]) + place, camera_in_world)
    assert network.observations.coordinates[0].xyz == (1.0, 2.0, 3.0)
    _assert_projects_as_opencv(network)
    with pytest.raises(ValidationError, match="'SP1' is no rotation and shift"):
        _network({"format": "riscan-project", "xml": re.sub(r"(<sop><matrix>)\S+", r"\g<1>7.0", xml)})


def _assert_projects_as_opencv(network: HybridNetwork) -> None:
    camera = network.cameras[0]
    distortion = camera.distortion
    assert distortion is not None
    tangent = np.array([0.2, -0.15])
    r2 = float(tangent @ tangent)
    radial = 1.0 - 0.1 * r2 + 0.1 * r2**2
    u, v = tangent
    by_cv = [
        u * radial + 2 * 0.001 * u * v + 0.002 * (r2 + 2 * u**2),
        v * radial + 0.001 * (r2 + 2 * v**2) + 2 * 0.002 * u * v,
    ]
    x, y = camera.principal_distance_px * u, -camera.principal_distance_px * v
    q2 = x**2 + y**2
    grown = distortion.A1 * q2 + distortion.A2 * q2**2
    dx = x * grown + distortion.B1 * (q2 + 2 * x**2) + 2 * distortion.B2 * x * y + distortion.C1 * x
    dy = y * grown + distortion.B2 * (q2 + 2 * y**2) + 2 * distortion.B1 * x * y
    ours = [x + dx + camera.x0_px, -(y + dy + camera.y0_px)]
    # the product of affinity and distortion is not held: a thousandth of 3 px
    np.testing.assert_allclose(ours, [3001 * by_cv[0] + 1500, 3000 * by_cv[1] + 1000], atol=0.01)


def test_approximate_coordinates_are_taken_as_the_arrays_of_a_request() -> None:
    network = {"format": "hybrid-network/1", "points_approx": {"P1": [1.0, 2.0, 3.0]}, "observations": {}}
    assert _network(network).points_approx == {"P1": (1.0, 2.0, 3.0)}
    with pytest.raises(ValidationError, match=r"points_approx\.P1\.1"):
        _network(network | {"points_approx": {"P1": [1.0, "2", 3.0]}})


REFERENCE = "# name y x z\nA 0 0 10\nB 100 0 12\nC 0 100 11\n"


def _jag3d(*files: dict[str, Any]) -> HybridNetwork:
    return _network({"format": "jag3d", "files": list(files)})


def test_texts_of_jag3d_are_read_by_their_columns_with_directions_turned() -> None:
    network = _jag3d(
        {"type": "reference-points", "text": REFERENCE},
        {"type": "stochastic-points", "text": "D 5 6 7 0.01 0.02"},
        {"type": "new-points", "text": "P 50 60 11 # about there"},
        {"type": "directions", "text": "A B 100.0 0.001\n\nA P 1.5 1.6 44.2 0.002"},
        {"type": "zenith-angles", "text": "A P 1.5 1.6 99.4", "std": 0.001},
        {"type": "slope-distances", "text": "A P 1.5 1.6 78.1 0.003\nB P 78.2 0.004"},
        {"type": "height-differences", "text": "A P 1.1 0.001"},
    )
    observed = network.observations
    assert [(c.point, c.held) for c in observed.control] == [("A", True), ("B", True), ("C", True), ("D", False)]
    np.testing.assert_allclose(np.sqrt(np.diag(np.array(observed.control[3].covariance))), [0.01, 0.01, 0.02])
    assert network.points_approx["P"] == (50.0, 60.0, 11.0)
    horizontal = [(o.point, o.horizontal, o.sigma_horizontal) for o in observed.polar if o.horizontal is not None]
    assert horizontal == [("B", -100.0, 0.001), ("P", -44.2, 0.002)]
    assert [(o.zenith, o.sigma_zenith, o.height_m) for o in observed.polar if o.zenith] == [(99.4, 0.001, 1.6)]
    assert [o.distance for o in observed.polar if o.distance] == [78.1]
    assert [(d.distance, d.sigma) for d in observed.distances] == [(78.2, 0.004)]
    assert [(h.difference, h.sigma) for h in observed.heights] == [(1.1, 0.001)]
    assert [station.height_m for station in network.stations if station.id.startswith("zenith")] == [1.5]


@pytest.mark.parametrize("faces", [1, 2])
def test_a_point_is_where_the_lines_of_jag3d_were_measured_from(faces: int) -> None:
    places = {"A": (0.0, 0.0, 10.0), "B": (100.0, 0.0, 12.0), "C": (0.0, 100.0, 11.0), "P": (50.0, 60.0, 13.0)}
    lines: dict[str, list[str]] = {"directions": [], "zenith-angles": [], "slope-distances": []}
    for target in "ABC":
        east, north, up = np.subtract(places[target], places["P"])
        up += 1.4 - 1.6
        length = float(np.linalg.norm([east, north, up]))
        bearing = float(np.arctan2(east, north)) * 200.0 / np.pi + 31.0
        zenith = float(np.arccos(up / length)) * 200.0 / np.pi
        for second in range(faces):
            lines["directions"].append(f"P {target} {(bearing + 200.0 * second) % 400.0:.9f} 0.0003")
            lines["zenith-angles"].append(f"P {target} 1.6 1.4 {400.0 - zenith if second else zenith:.9f} 0.0003")
        lines["slope-distances"].append(f"P {target} 1.6 1.4 {length:.9f} 0.001")
    files = [{"type": kind, "text": "\n".join(rows)} for kind, rows in lines.items()]
    files = [{"type": "reference-points", "text": REFERENCE}, *files, {"type": "new-points", "text": "P 51 58 12.5"}]
    inputs = AdjustInputs.model_validate({
        "network": {"format": "jag3d", "files": files}, "datum": {"type": "control"}, "gross_errors": "none",
    })  # fmt: skip
    document, *_ = adjusted_document(inputs.model_dump(mode="json"), "job", NoProgress())
    (found,) = [each for each in document.points if each.id == "P"]
    np.testing.assert_allclose(found.xyz_m, places["P"], atol=1e-6)


@pytest.mark.parametrize(
    ("kind", "text", "what"),
    [
        ("directions", "A B 100.0", "line 1 has no standard deviation; state it in the line, in gon"),
        ("zenith-angles", "A B 100.0 78.2", "has 78.2 for a standard deviation"),
        ("slope-distances", "A B 10,5 0.001", "'10,5 0.001' are no numbers"),
        ("new-points", "P 1 2", "a point is `name y x z`"),
        ("stochastic-points", "P 1 2 3", "a stochastic point has standard deviations"),
        ("height-differences", "A B 1.5 1.6 0.1 0.001", "between points above their marks"),
        ("gnss", "A B 1 2 3", "files/0/type"),
    ],
)
def test_lines_of_jag3d_that_say_too_little_are_refused_by_type_and_line(kind: str, text: str, what: str) -> None:
    with pytest.raises(ValidationError, match=re.escape(what)):
        _jag3d({"type": kind, "text": text})
