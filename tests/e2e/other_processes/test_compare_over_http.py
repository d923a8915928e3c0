"""Clouds, meshes and planes go in over HTTP; deviations with statistics, pictures and points come out."""

import io
import json
from pathlib import Path

import laspy
import numpy as np
import pytest

from algorithms.scans.scan import Scan
from service.formats.writers import write_scans
from tests.e2e.running.running_service import Document, RunningService

ORIGIN_M = np.array([500_000.0, 5_800_000.0, 100.0])
LIFTED_M = 0.008
COVARIANCE = np.zeros((12, 12))
COVARIANCE[6:, 6:] = np.diag([0.0, 0.0, 0.0, 4e-6, 4e-6, 4e-6])
OBJ = "v 500000 5800000 100\nv 500004 5800000 100\nv 500004 5800004 100\nv 500000 5800004 100\nf 1 2 3\nf 1 3 4\n"


def floor(seed: int, lift_m: float) -> np.ndarray:
    rng = np.random.default_rng(seed)
    uv = rng.uniform(0.0, 4.0, (30_000, 2))
    height = rng.normal(0.0, 0.002, len(uv))
    height[(uv[:, 0] > 2.5) & (uv[:, 1] > 2.5)] += lift_m
    return np.column_stack([uv, height])


def uploaded(service: RunningService, folder: Path, name: str, points: np.ndarray) -> str:
    write_scans(folder / name, [Scan(points, ORIGIN_M, name)])
    return str(service.upload(folder / name)["id"])


@pytest.fixture(scope="module")
def files(service: RunningService, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("compare")
    (folder / "floor.obj").write_text(OBJ)
    return {
        "before": uploaded(service, folder, "before.ply", floor(1, 0.0)),
        "after": uploaded(service, folder, "after.ply", floor(2, LIFTED_M)),
        "elsewhere": uploaded(service, folder, "elsewhere.ply", floor(3, 0.0) + np.array([0.0, 500.0, 0.0])),
        "mesh": str(service.upload(folder / "floor.obj")["id"]),
    }


def station(file: str, name: str = "S1") -> list[Document]:
    return [{"name": name, "scan": {"file": file}}]


def compared(service: RunningService, inputs: Document) -> Document:
    return service.result(service.execute("compare", inputs))


@pytest.fixture(scope="module")
def epochs(service: RunningService, files: dict[str, str]) -> Document:
    inputs = {
        "cloud": station(files["after"]),
        "reference": station(files["before"]),
        "joint_covariance": COVARIANCE.tolist(),
        "raster": {"cell_m": 0.1},
    }
    return compared(service, inputs)


def test_a_lifted_part_is_significant_and_the_rest_is_not(epochs: Document) -> None:
    figures = epochs["m3c2"]
    assert figures["median_pose_std_m"] == pytest.approx(0.002, rel=0.1)
    assert figures["measured"] > 1000
    # 14 % of the floor were lifted by 8 mm, twice what the level of detection is
    assert 0.8 * 0.14 < figures["significant"] / figures["measured"] < 0.3
    assert epochs["figures"]["quantiles"][3]["deviation_m"] == pytest.approx(0.0, abs=0.001)
    assert sum(epochs["histogram"]["counts"]) > 0


def test_a_viewer_shows_where_deviations_are_and_greys_what_is_not_significant(
    service: RunningService, epochs: Document
) -> None:
    job = epochs["artifacts"][0]["href"].split("/artifacts/")[0]
    scene = service.http.get(f"{job}/scene").json()
    (cloud,) = scene["clouds"]
    data = service.http.get(cloud["href"]).content
    assert len(data) == 16 * cloud["blocks"]["points"] == 16 * epochs["m3c2"]["core_points"]
    colours = []
    for *_, first, count in cloud["blocks"]["nodes"]:
        channels = np.frombuffer(data, dtype="u1", count=4 * count, offset=first + 12 * count)
        colours.append(channels.reshape(count, 4)[:, 1:])
    told, figures = np.concatenate(colours), epochs["m3c2"]
    legend = scene["deviations"]
    grey = int((told == legend["insignificant"]).all(axis=1).sum())
    assert grey == figures["measured"] - figures["significant"]
    reddest = int((told == legend["colours"][-1]).all(axis=1).sum())
    assert 0 < reddest <= figures["significant"]
    page = service.http.get(f"{job}/results", headers={"Accept": "text/html"}).text
    assert 'id="viewer" data-job="' in page


def test_pictures_and_grids_are_downloads(service: RunningService, epochs: Document) -> None:
    names = {each["name"] for each in epochs["artifacts"]}
    assert {"histogram.svg", "deviations.png", "difference.asc", "difference.png", "density-cloud.png"} <= names
    (grid,) = [each for each in epochs["artifacts"] if each["name"] == "difference.asc"]
    lines = service.http.get(grid["href"]).text.splitlines()
    assert lines[2] == "xllcorner 500000.000000"
    assert epochs["pattern"]["common_cells"] > 1000


@pytest.mark.parametrize("reference", ["mesh", "planes"])
def test_a_mesh_and_a_plane_give_the_same_deviations(
    service: RunningService, files: dict[str, str], reference: str
) -> None:
    given = {
        "mesh": {"mesh": {"file": files["mesh"]}},
        "planes": {"planes": [{"name": "floor", "point_m": ORIGIN_M.tolist(), "normal": [0, 0, 2]}]},
    }[reference]
    found = compared(service, {"cloud": station(files["after"]), **given})
    assert found["figures"]["count"] == pytest.approx(30_000, abs=10)
    assert found["figures"]["mean_m"] == pytest.approx(LIFTED_M * 1.5**2 / 16.0, abs=1e-4)
    if reference == "mesh":
        assert not found["mesh"]["closed"]
        assert any("holes" in remark for remark in found["remarks"])
    else:
        assert found["planes"][0]["figures"]["count"] == found["figures"]["count"]


def test_points_with_their_deviations_are_an_output(service: RunningService, files: dict[str, str]) -> None:
    inputs = {"cloud": station(files["after"]), "mesh": {"file": files["mesh"]}}
    wanted = {"inputs": inputs, "outputs": {"deviations": {"format": "laz"}, "figures": {}}}
    job = service.post("/processes/compare/execution", json=wanted).json()["jobID"]
    (download,) = service.result(job)["deviations"]
    points = laspy.read(io.BytesIO(service.http.get(download["href"]).content))
    assert np.abs(points["deviation_mm"] / 1e3 - (points.z - ORIGIN_M[2])).max() < 2e-4
    assert len(np.unique(points.red)) > 3


@pytest.mark.parametrize("reference", ["reference", "mesh"])
def test_surfaces_of_other_places_are_refused_clearly(
    service: RunningService, files: dict[str, str], reference: str
) -> None:
    given = {"reference": station(files["before"]), "mesh": {"file": files["mesh"]}}[reference]
    job = service.execute("compare", {"cloud": station(files["elsewhere"]), reference: given})
    failed = service.finished(job)
    assert failed["status"] == "failed"
    assert "nothing in common" in json.dumps(failed)


@pytest.mark.parametrize(
    ("change", "pointer"),
    [
        ({"mesh": {"file": "nothing"}}, "/inputs/mesh/file"),
        ({"planes": [{"name": "p", "point_m": [0, 0, 0], "normal": [0, 0, 0]}]}, "/inputs/planes/0"),
        ({}, "/inputs"),
    ],
)
def test_what_is_missing_or_impossible_is_named(
    service: RunningService, files: dict[str, str], change: Document, pointer: str
) -> None:
    answer = service.post("/processes/compare/execution", json={"inputs": {"cloud": station(files["after"]), **change}})
    assert answer.status_code == 400
    assert any(fault["pointer"].startswith(pointer) for fault in answer.json()["errors"])


def rolling(seed: int, lower_m: float) -> np.ndarray:
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0.0, 40.0, (20_000, 2))
    z = 0.5 * np.sin(xy[:, 0] / 9) + 0.4 * np.cos(xy[:, 1] / 7) + 0.03 * xy[:, 0] - lower_m
    return np.column_stack([xy, z + rng.normal(0.0, 0.01, len(xy))])


def wall(seed: int, moved_m: float) -> np.ndarray:
    """Scatter points over a wall of 12 m that looks to the south."""
    rng = np.random.default_rng(seed)
    xz = rng.uniform(0.0, 1.0, (20_000, 2)) * [12.0, 5.0]
    return np.column_stack([xz[:, 0], rng.normal(0.0, 0.003, len(xz)) - moved_m, xz[:, 1]])


WIDE = {"cylinder_radius_m": 0.5, "normal_radii_m": [1.5]}
SINKING = [
    ("ground in UTM", rolling, ORIGIN_M, None, -0.05, "up"),
    ("ground about the origin of its file", rolling, np.zeros(3), None, -0.05, "up"),
    ("ground above that origin", rolling, np.array([0.0, 0.0, 100.0]), None, -0.05, "up"),
    ("ground below that origin", rolling, np.array([0.0, 0.0, -100.0]), None, -0.05, "up"),
    ("ground, the underside stated", rolling, ORIGIN_M, {"direction": [0.0, 0.0, -1.0]}, 0.05, "stated"),
    ("wall that came towards a stated place", wall, ORIGIN_M, {"point_m": [5e5, 5.8e6 - 50.0, 100.0]}, 0.05, "stated"),
    ("wall that went away", wall, ORIGIN_M, {"direction": [0.1, 1.0, 0.0]}, -0.05, "stated"),
    ("wall about the origin of its file", wall, np.array([-6.0, 0.01, -2.0]), None, None, "arbitrary"),
    ("wall in UTM", wall, ORIGIN_M, None, None, "arbitrary"),
]


@pytest.mark.parametrize("method", ["m3c2", "nearest"])
@pytest.mark.parametrize("case", SINKING, ids=[case[0] for case in SINKING])
def test_what_moved_has_one_sign_everywhere_or_an_arbitrary_one(
    service: RunningService, tmp_path: Path, case: tuple[object, ...], method: str
) -> None:
    _, surface, origin, towards, mean_m, side = case
    stations = []
    for number, moved in enumerate((0.0, 0.05)):
        path = tmp_path / f"{number}.las"
        cloud = laspy.LasData(laspy.LasHeader(point_format=3, version="1.4"))
        cloud.header.offsets, cloud.header.scales = origin, [0.0001] * 3
        cloud.x, cloud.y, cloud.z = (surface(number, moved) + origin).T  # type: ignore[operator]
        cloud.write(path)
        stations.append(station(str(service.upload(path)["id"])))
    inputs = {"reference": stations[0], "cloud": stations[1], "method": method, "towards": towards, "m3c2": WIDE}
    found = compared(service, {**inputs, "core_spacing_m": 1.0})
    assert found["positive_side"] == side
    job = found["artifacts"][0]["href"].split("/artifacts/")[0]
    assert service.http.get(f"{job}/scene").json()["deviations"]["sign_is_arbitrary"] is (side == "arbitrary")
    assert found["figures"]["std_m"] < 0.02
    if mean_m is None:
        assert found["figures"]["mean_m"] is None
        assert abs(found["figures"]["quantiles"][3]["deviation_m"]) == pytest.approx(0.05, abs=0.005)
        assert any("arbitrary" in remark for remark in found["remarks"])
    else:
        assert found["figures"]["mean_m"] == pytest.approx(mean_m, abs=0.005)
