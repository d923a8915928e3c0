"""In which coordinate reference system registered points are said to be."""

from service.use_cases.steps.projected_clouds import LOCAL, world_system

OPTIONS = {"format": "laz", "crs": "EPSG:25832"}


def test_poses_of_a_local_frame_are_not_said_to_be_in_a_projection():
    of_control = {"control": {"system": {"crs": "EPSG:25832", "origin": [500000.0, 5400000.0, 300.0]}}}
    found = world_system(OPTIONS, None, [of_control])
    assert found.crs_wkt is None
    assert found.notes == (LOCAL,)


def test_other_poses_are_in_the_system_that_was_stated():
    found = world_system(OPTIONS, None, [{"control": None}, {}])
    assert found.crs_wkt is not None
    assert found.crs_wkt.startswith("PROJCS")
    assert found.notes == ()
