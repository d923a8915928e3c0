"""Result document of the process `simulate`."""

from pydantic import Field

from schemas.results.registration_result import Artifact
from schemas.values.poses import Document, PointStd, PoseStd, Row4


class SimulatedInstrument(Document):
    """The data sheet that was used."""

    name: str
    """As requests name it."""
    title: str
    """What it is, in words."""
    source: str
    """Where its figures come from."""
    step_gon: float
    """Angle between neighbouring beams [gon]."""
    range_std_m: float
    """Standard deviation of a range of 10 m to a half grey surface that faces the beam [m]."""
    footprint_at_50m_m: float
    """Diameter of the footprint at 50 m [m]."""
    max_range_m: float
    """Farthest that anything comes back [m]."""
    points_at_once: int = Field(description="Beams of one scan.")
    minutes: float = Field(description="That one scan takes.")


class SimulatedPhoto(Document):
    """A photo that was taken."""

    name: str
    """Name of the download."""
    scan_from_camera: tuple[Row4, Row4, Row4, Row4]
    """Its true pose, 4×4 row by row."""
    stated_scan_from_camera: tuple[Row4, Row4, Row4, Row4]
    """Where the camera is said to sit; the true pose unless `errors` moves it."""


class SimulatedStation(Document):
    """One set-up and its scan."""

    name: str
    """Name of the station."""
    world_from_scan: tuple[Row4, Row4, Row4, Row4]
    """The true pose, 4×4 row by row."""
    file: str
    """Name of the download with the scan."""
    points: int
    """What came back."""
    lines: int | None = Field(description="Lines found in it; null: not looked for.")
    planes: int | None = Field(description="Planes found in it; null likewise.")
    photos: list[SimulatedPhoto]
    """Its photos."""
    expected_status: str | None = Field(
        description="fixed, registered or unregistered in the network; null: nothing was registered."
    )
    expected_std: PoseStd | None = Field(
        description="Standard deviations of its pose in the frame of the first station; null: not registered."
    )
    expected_point_std_m: float | None = Field(
        description="Standard deviation of a point 10 m in front of the instrument by that of the pose: √(σx² + σy² + "
        "σz²) [m]; null likewise."
    )
    error_gon: float | None = Field(description="Angle between the pose found and the true one; null likewise.")
    error_m: float | None = Field(description="How far the instrument is from its true place; null likewise.")


class ExpectedPair(Document):
    """What is to be expected of two set-ups."""

    target: str
    """Name of the station that gives the frame."""
    source: str
    """Name of the other station."""
    overlap_0_5m: float = Field(description="Share of the target's points with a point of the source within 0.5 m.")
    overlap_back_0_5m: float = Field(description="The same of the source's points.")
    status: str | None = Field(description="Verdict of the registration; null: not tried, being too far apart.")
    link: str | None = Field(description="State in the network: used, uncontrolled or rejected; null: no link.")
    std: PoseStd | None = Field(description="Standard deviations of the pose; null: there is none.")
    std_at_centroid_m: PointStd | None = Field(description="Those of the shift where the features lie.")
    reason: str
    """The weightiest reason of the verdict; empty where there is none."""


class SimulationDocument(Document):
    """Answer of `simulate`."""

    scene: str
    """Name of the scene."""
    triangles: int
    """Triangles of the scene."""
    instrument: SimulatedInstrument
    """What was used."""
    stations: list[SimulatedStation]
    """The set-ups."""
    pairs: list[ExpectedPair]
    """Overlaps and links to expect; empty where nothing was to be registered."""
    connected: bool | None = Field(description="Whether all stations are registered; null: nothing was.")
    seed: int
    """Of the noise."""
    remarks: list[str]
    """What else is to be said, in words."""
    artifacts: list[Artifact]
    """The scans, photos, `truth.json`, `photos.json` and the plan of the network."""
