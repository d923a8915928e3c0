"""Inputs of the process `simulate`."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from schemas.values.base import RequestModel
from schemas.values.file_references import FileReference
from schemas.values.station_names import StationName
from schemas.values.units import StatedUnit

SceneName: TypeAlias = Literal[
    "house", "house_front", "pipe_hall", "office", "corridor", "bridge", "street_square", "holzmarkt",
    "parallel_pipes", "single_plane",
]  # fmt: skip
"""Names of `algorithms.simulation.scenes.SCENES`, which would load numpy into the web process; likewise below."""
MaterialName: TypeAlias = Literal[
    "plaster", "paint", "concrete", "brick", "roof tiles", "wood", "steel", "lawn", "foliage", "textile", "gravel",
    "glass", "maple leaf", "oak leaf", "aluminium foil", "asphalt", "chrome", "stainless steel",
    "oxidised stainless steel", "copper", "maize leaves", "platinum", "wet sand", "dry sand", "dry silt", "snow",
    "terracotta", "water", "wheat stalk", "wheat ear", "cement",
]  # fmt: skip
InstrumentName: TypeAlias = Literal["riegl-lms-z360i", "riegl-lms-z420i", "phase-79m", "phase-120m"]
Coordinate: TypeAlias = Annotated[float, Field(ge=-1e5, le=1e5)]
Place: TypeAlias = tuple[Coordinate, Coordinate, Coordinate]


class SceneMesh(FileReference):
    """A triangle mesh in a PLY, OBJ or STL file."""

    unit: StatedUnit | None = None
    """In which unit its coordinates are: `mm`, `m`, `ft` or `us-ft`; null: metres, for mesh formats state none."""
    material: MaterialName = "plaster"
    """What it is made of."""
    reflectance: float | None = Field(default=None, gt=0.0, le=1.0)
    """Diffuse reflectance at the scanner's wavelength; null: that of the material."""


class GivenPlane(RequestModel):
    """A plane surface; both of its sides are seen."""

    name: StationName
    """What it is called in refusals."""
    outline_m: list[Place] = Field(min_length=3, max_length=1000)
    """Corners of its outline in order [m]; it may have re-entrant corners and no holes."""
    material: MaterialName = "plaster"
    """What it is made of."""
    reflectance: float | None = Field(default=None, gt=0.0, le=1.0)
    """Diffuse reflectance at the scanner's wavelength; null: that of the material."""


class PlannedStation(RequestModel):
    """Where the scanner is to stand."""

    name: StationName
    """Name of the station, unique in the job."""
    position_m: Place
    """Centre of the instrument in the scene [m]."""
    heading_gon: float = Field(default=0.0, ge=-400.0, le=400.0)
    """Turn of the scanner's x axis from that of the scene, anticlockwise seen from above [gon]."""
    tilt_x_gon: float = Field(default=0.0, ge=-200.0, le=200.0)
    """Tilt of the tripod about the scanner's x axis [gon]."""
    tilt_y_gon: float = Field(default=0.0, ge=-200.0, le=200.0)
    """Tilt of the tripod about the scanner's y axis, after that about x [gon]."""


class PlannedPhotos(RequestModel):
    """Photos to be taken from every station, by a camera of six megapixels and 14 mm on top of the scanner."""

    count: int = Field(default=6, ge=1, le=12)
    """So many, evenly spread over the horizon."""
    scale: float = Field(default=0.25, ge=0.05, le=1.0)
    """Of the photo's sides; 1 gives 3008 by 2000 pixels, which take minutes."""
    down_gon: float = Field(default=0.0, ge=-60.0, le=60.0)
    """How far the camera looks below the horizon [gon]."""


Milligon: TypeAlias = Annotated[float, Field(ge=-5000.0, le=5000.0)]
Millimetres: TypeAlias = Annotated[float, Field(ge=-1000.0, le=1000.0)]


class TripodDrift(RequestModel):
    """A turn of a tripod from the first column of its scan to the last; the true pose is that of the mean."""

    station: StationName
    """Whose tripod."""
    tilt_x_mgon: Milligon = 0.0
    """About the scanner's x axis [mgon]."""
    tilt_y_mgon: Milligon = 0.0
    """About the scanner's y axis [mgon]."""
    heading_mgon: Milligon = 0.0
    """About its vertical axis [mgon]."""
    bend_mgon: tuple[Milligon, Milligon, Milligon] = (0.0, 0.0, 0.0)
    """By how much more it is turned about these axes at start and end than in the middle [mgon]."""


class SimulatedErrors(RequestModel):
    """What is out of adjustment, recorded minus true: to see whether `scanner` and `calibrate-mount` find it."""

    vertical_index_mgon: Milligon = 0.0
    """Of every elevation [mgon]."""
    range_offset_mm: Millimetres = 0.0
    """Of every range [mm]."""
    range_scale_ppm: float = Field(default=0.0, ge=-10000.0, le=10000.0)
    """Of every range, in proportion to it [ppm]."""
    collimation_mgon: Milligon = 0.0
    """Between the line of sight and the normal of the trunnion axis [mgon]."""
    trunnion_mgon: Milligon = 0.0
    """Tilt of the trunnion axis [mgon]."""
    incidence_offset_mm: Millimetres = 0.0
    """Of ranges measured at 70 degrees from the normal; it grows with the tangent of that angle [mm]."""
    tripods: list[TripodDrift] = Field(default=[], max_length=1000)
    """Tripods that turn while they are scanned from."""
    mount_rotation_mgon: tuple[Milligon, Milligon, Milligon] = (0.0, 0.0, 0.0)
    """Turn of the camera against its stated mount, about its own axes right, down, forward [mgon]."""
    mount_shift_mm: tuple[Millimetres, Millimetres, Millimetres] = (0.0, 0.0, 0.0)
    """Shift of its projection centre along these axes [mm]."""

    @property
    def moves_camera(self) -> bool:
        """Whether the camera does not sit where it is said to sit."""
        return any((*self.mount_rotation_mgon, *self.mount_shift_mm))


class SimulateInputs(RequestModel):
    """What is to be scanned, from where and with what."""

    mesh: SceneMesh | None = Field(default=None, title="Scene as a mesh")
    """A mesh as scene, in coordinates with z upwards."""
    scene: SceneName | None = Field(default=None, title="Scene")
    """A scene that is built in."""
    planes: list[GivenPlane] | None = Field(default=None, min_length=1, max_length=5000, title="Scene of planes")
    """Planes as scene."""
    instrument: InstrumentName = Field(default="phase-79m", title="Instrument")
    """Whose data sheet is used: range, noise by distance and reflectance, divergence, field of view."""
    step_gon: float | None = Field(default=None, ge=0.05, le=10.0, title="Step")
    """Angle between neighbouring beams on both circles; null: the instrument's usual one [gon]."""
    shots: int = Field(default=1, ge=1, le=100, title="Shots")
    """Each range is the mean of so many measurements."""
    attenuation_db_per_km: float = Field(default=0.0, ge=0.0, le=100.0, title="Air")
    """Attenuation by the air in one direction: 0.2 to 0.8 where it is clear, 3.9 in haze [dB/km]."""
    intensity_reference_m: float = Field(default=0.0, ge=0.0, le=1000.0, title="Intensity")
    """Distance at which a white surface that faces the beam has intensity 1; it falls with the square of the distance
    (radar equation). 0: the instrument takes the distance out [m]."""
    stations: list[PlannedStation] | None = Field(default=None, min_length=1, title="Stations")
    """The set-ups; null: those that a built-in scene recommends."""
    photos: PlannedPhotos | None = Field(default=None, title="Photos")
    """Photos from every station; null: none."""
    errors: SimulatedErrors | None = Field(default=None, title="Errors")
    """Of instrument, tripods and camera; null: all are in adjustment."""
    expect: bool = Field(default=True, title="What to expect")
    """Whether the scans are also registered without a first guess, to learn which overlaps, links and standard
    deviations a network of these set-ups would have."""
    format: Literal["e57", "laz", "ptx", "ply"] = Field(default="e57", title="Format")
    """Of the scans; points in the scanner's frame."""
    with_poses: bool = Field(default=False, title="With poses")
    """Whether E57 and PTX say the true poses, and LAZ and PLY have the points in the frame of the scene. Otherwise they
    are in `truth.json` alone."""
    seed: int = Field(default=1, ge=0, le=2**31 - 1, title="Seed")
    """Of all noise: the same seed gives the same scans."""

    @model_validator(mode="after")
    def _one_scene(self) -> "SimulateInputs":
        if sum(each is not None for each in (self.mesh, self.scene, self.planes)) != 1:
            raise PydanticCustomError("one_scene", "give one of scene, mesh and planes")
        if self.scene is None and self.stations is None:
            raise PydanticCustomError("planned_stations", "say in `stations` where the scanner stands")
        if self.errors is not None and self.stations is not None:
            names = {each.station for each in self.errors.tripods} - {each.name for each in self.stations}
            if names:
                named = {"names": ", ".join(sorted(names))}
                raise PydanticCustomError("tripod_station", "`errors.tripods`: there is no station {names}", named)
        if self.errors is not None and self.photos is None and self.errors.moves_camera:
            raise PydanticCustomError("mount_photos", "`errors` moves a camera, but no `photos` are taken")
        return self
