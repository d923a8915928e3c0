"""A rigid motion as it stands in a request."""

from typing import Annotated

from pydantic import AfterValidator, Field
from pydantic_core import PydanticCustomError

ROTATION_TOLERANCE = 1e-3
"""Matrices are often written with few digits; beyond this it is no rotation any more."""
MAX_TRANSLATION_M = 1e9

Row = Annotated[list[Annotated[float, Field(allow_inf_nan=False)]], Field(min_length=4, max_length=4)]


def _rigid(matrix: list[list[float]]) -> list[list[float]]:
    if matrix[3] != [0.0, 0.0, 0.0, 1.0]:
        raise PydanticCustomError("rigid_last_row", "the last row of a rigid 4×4 matrix is 0, 0, 0, 1")
    if any(abs(row[3]) > MAX_TRANSLATION_M for row in matrix[:3]):
        raise PydanticCustomError("rigid_translation", "a translation component exceeds 1e9 m")
    (a, b, c), (d, e, f), (g, h, i) = (row[:3] for row in matrix[:3])
    if any(abs(element) > 1.0 + ROTATION_TOLERANCE for element in (a, b, c, d, e, f, g, h, i)):
        raise PydanticCustomError("rigid_rotation", "the upper left 3×3 block is not a rotation")
    rows = ((a, b, c), (d, e, f), (g, h, i))
    dots = [sum(x * y for x, y in zip(rows[p], rows[q], strict=True)) - (p == q) for p in range(3) for q in range(3)]
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    if max(abs(dot) for dot in dots) > ROTATION_TOLERANCE or determinant < 0.0:
        raise PydanticCustomError("rigid_rotation", "the upper left 3×3 block is not a rotation")
    return matrix


RigidMatrix = Annotated[list[Row], Field(min_length=4, max_length=4), AfterValidator(_rigid)]
"""4×4 row-major matrix M of a rigid motion, x_target = M x_source, translation in metres."""
