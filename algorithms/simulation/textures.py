"""Patterns on flat faces: edges that a photo shows and a point cloud does not.

A face has coordinates u (level, along the face) and v (up the slope; the height on upright faces), counted from the
world's origin; on level faces u and v are the world's x and y. Two faces in one plane share them.
"""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Indices, Points, Scalars, Vector3

Color = tuple[float, float, float]
"""Linear albedo in red, green and blue, 0..1."""
LEVEL_COSINE = 0.9
"""Faces whose normal is nearer to the vertical are level ones."""


def face_axes(normals: Points) -> tuple[Points, Points]:
    """Give the unit axes u and v, each (n, 3), of faces with unit normals (n, 3); opposite normals give the same."""
    leading = np.argmax(np.abs(normals) > 0.1, axis=1)
    upright = normals * np.sign(normals[np.arange(len(normals)), leading])[:, None]
    u = np.column_stack([-upright[:, 1], upright[:, 0], np.zeros(len(normals))])
    level = np.abs(normals[:, 2]) > LEVEL_COSINE
    u[level] = (1.0, 0.0, 0.0)
    # Level faces may be tilted a little: u is brought into the face.
    u -= np.einsum("ij,ij->i", u, upright)[:, None] * upright
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(upright, u)
    v[level] *= np.sign(v[level, 1])[:, None]
    return u, v


@dataclass(frozen=True)
class Stripes:
    """Stripes of another colour, painted along u, along v or both."""

    color: Color
    """Of the paint."""
    levels_m: tuple[tuple[float, float], ...] = ()
    """Stripes along u: from v to v."""
    columns_m: tuple[tuple[float, float], ...] = ()
    """Stripes along v: from u to u."""

    def paint(self, u: Scalars, v: Scalars, base: Vector3) -> tuple[Points, Indices]:
        """Give colours (n, 3) and numbers (n,) of the fields at face coordinates (n,)."""
        painted = np.zeros(len(u), dtype=bool)
        for low, high in self.levels_m:
            painted |= (v > low) & (v < high)
        for low, high in self.columns_m:
            painted |= (u > low) & (u < high)
        return np.where(painted[:, None], np.array(self.color), base), painted.astype(np.int64)

    def edges(self, low: Array, high: Array) -> Array:
        """Give the edges (e, 2, 2) of the stripes, (u, v) at both ends, between two corners (2,) of a rectangle."""
        level = [[(low[0], v), (high[0], v)] for stripe in self.levels_m for v in stripe]
        upright = [[(u, low[1]), (u, high[1])] for stripe in self.columns_m for u in stripe]
        return np.array(level + upright, dtype=np.float64).reshape(-1, 2, 2)


@dataclass(frozen=True)
class Courses:
    """Bricks in running bond with joints; every brick has a brightness of its own."""

    joint_color: Color = (0.55, 0.53, 0.50)
    """Of the mortar."""
    course_m: float = 0.075
    """From one bed joint to the next."""
    length_m: float = 0.25
    """From one cross joint to the next."""
    joint_m: float = 0.012
    """Width of the joints."""
    variation: float = 0.12
    """Largest relative difference of a brick's brightness from the mean."""

    def paint(self, u: Scalars, v: Scalars, base: Vector3) -> tuple[Points, Indices]:
        """Give colours (n, 3) and numbers (n,) of the bricks at face coordinates (n,), number 0 for joints."""
        course = np.floor(v / self.course_m)
        along = u + 0.5 * self.length_m * np.mod(course, 2.0)
        brick = np.floor(along / self.length_m)
        joint = (v - course * self.course_m < self.joint_m) | (along - brick * self.length_m < self.joint_m)
        # A fixed scramble of the numbers of course and brick, so that nothing depends on a state.
        scramble = np.sin(12.9898 * course + 78.233 * brick) * 43758.5453
        shade = 1.0 + self.variation * (2.0 * (scramble - np.floor(scramble)) - 1.0)
        colors = np.where(joint[:, None], np.array(self.joint_color), base * shade[:, None])
        numbers = np.where(joint, 0, (1 + np.abs(course) * 65_536 + np.abs(brick)).astype(np.int64))
        return colors, numbers

    def edges(self, low: Array, high: Array) -> Array:
        """Give both edges of every bed joint, (e, 2, 2), between two corners (2,); cross joints are too short."""
        courses = self.course_m * np.arange(np.floor(low[1] / self.course_m), np.ceil(high[1] / self.course_m) + 1)
        heights = np.sort(np.concatenate([courses, courses + self.joint_m]))
        ends = [[(low[0], v), (high[0], v)] for v in heights]
        return np.array(ends, dtype=np.float64).reshape(-1, 2, 2)


Texture = Stripes | Courses
"""Any pattern; each gives the colour at a place and its own straight edges."""
