"""Two of the three answers on a pose: what is determined, and how well; the first is `place`."""

from pydantic import Field

from schemas.values.poses import Document


class Determined(Document):
    """Whether the data determine all parameters of a pose."""

    rank: int = Field(description="Determined parameters, 0 to 6.")
    free: list[str] = Field(description="Motions that nothing determines, in words; empty: none.")
    advice: str = Field(description="What to add; empty where nothing is free.")


class Precision(Document):
    """How well a determined pose is known, apart from whether it is the right one."""

    tolerance_m: float = Field(description="Standard deviation allowed at the far end.")
    tolerance_stated: bool = Field(description="Whether the request states it; else it is what the scans allow.")
    kept: bool = Field(description="Whether the pose is as precise as asked; where it is not, it is coarse at best.")
    centre_std_m: float = Field(
        description="Standard deviation of the worst motion where the common features and surfaces are; turns as the "
        "shift they cause there."
    )
    far_m: float = Field(description="Distance of the far end of the smaller scan from there.")
    far_std_m: float = Field(description="Standard deviation of the worst motion at the far end.")
    std_gon: float = Field(description="Standard deviation of the turn about the worst axis.")
    undetected_m: float | None = Field(
        description="Shift of the pose by the largest error that no test finds; null: an error of any size."
    )
    findings: list[str] = Field(description="What exceeds the tolerance or contradicts the precision, in words.")
