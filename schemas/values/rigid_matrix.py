"""A rigid motion as it stands in a request."""

import math
from typing import Annotated

from pydantic import AfterValidator, Field
from pydantic_core import PydanticCustomError

ROTATION_TOLERANCE = 1e-3
"""Matrices are often written with few digits; beyond this it is no rotation any more."""
MAX_TRANSLATION_M = 1e9
MAX_ELEMENT = 1e6
"""Larger elements are no scale that anybody meant, and their squares would overflow."""

Row = Annotated[list[Annotated[float, Field(allow_inf_nan=False)]], Field(min_length=4, max_length=4)]


def _rigid(matrix: list[list[float]]) -> list[list[float]]:
    if matrix[3] != [0.0, 0.0, 0.0, 1.0]:
        raise PydanticCustomError("rigid_last_row", "the last row of a rigid 4×4 matrix is 0, 0, 0, 1")
    if any(abs(row[3]) > MAX_TRANSLATION_M for row in matrix[:3]):
        raise PydanticCustomError("rigid_translation", "a translation component exceeds 1e9 m")
    (a, b, c), (d, e, f), (g, h, i) = (row[:3] for row in matrix[:3])
    rows = ((a, b, c), (d, e, f), (g, h, i))
    if max(abs(element) for row in rows for element in row) > MAX_ELEMENT:
        raise PydanticCustomError("rigid_rotation", "the upper left 3×3 block is not a rotation")
    dots = [[sum(x * y for x, y in zip(first, second, strict=True)) for second in rows] for first in rows]
    scale = math.sqrt(dots[0][0])
    if max(abs(dots[p][q] - (p == q) * dots[0][0]) for p in range(3) for q in range(3)) > ROTATION_TOLERANCE * max(
        1.0, dots[0][0]
    ):
        raise PydanticCustomError(
            "rigid_rotation",
            "the upper left 3×3 block is not a rotation: its rows are not perpendicular and equally long",
        )
    if abs(dots[0][0] - 1.0) > ROTATION_TOLERANCE:
        raise PydanticCustomError(
            "rigid_rotation",
            "the upper left 3×3 block is not a rotation: it scales by {scale}; a rigid motion keeps lengths, in metres",
            {"scale": f"{scale:.6g}"},
        )
    if a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) < 0.0:
        raise PydanticCustomError(
            "rigid_rotation",
            "the upper left 3×3 block is not a rotation: it mirrors (determinant -1); frames are right-handed",
        )
    return matrix


RigidMatrix = Annotated[list[Row], Field(min_length=4, max_length=4), AfterValidator(_rigid)]
"""4×4 row-major matrix M of a rigid motion, x_target = M x_source, translation in metres."""
