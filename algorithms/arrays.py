"""Array types with their shapes. Shapes are checked under pytest (jaxtyping + beartype), never in production."""

from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64, UInt8

Array: TypeAlias = np.ndarray
Generator: TypeAlias = np.random.Generator

Points: TypeAlias = Float64[Array, "n 3"]
"""n points or directions, one a row."""
OtherPoints: TypeAlias = Float64[Array, "m 3"]
"""Points beside others of a different number."""
CorePoints: TypeAlias = Float64[Array, "k 3"]
"""Places at which something is measured on points, or directions there."""
CoreScalars: TypeAlias = Float64[Array, "k"]
Vector3: TypeAlias = Float64[Array, "3"]
Vectors2: TypeAlias = Float64[Array, "n 2"]
Scalars: TypeAlias = Float64[Array, "n"]
Matrix3: TypeAlias = Float64[Array, "3 3"]
Matrix4: TypeAlias = Float64[Array, "4 4"]
Matrix6: TypeAlias = Float64[Array, "6 6"]
Matrices3: TypeAlias = Float64[Array, "n 3 3"]
Matrices4: TypeAlias = Float64[Array, "n 4 4"]
Bases: TypeAlias = Float64[Array, "n 3 2"]
"""n orthonormal 3x2 bases, columns E1 and E2."""
Matrix: TypeAlias = Float64[Array, "rows columns"]
Vector: TypeAlias = Float64[Array, "rows"]
Floats32: TypeAlias = Float32[Array, "n"]
Colors: TypeAlias = UInt8[Array, "n 3"]
Indices: TypeAlias = Int64[Array, "n"]
IndexPairs: TypeAlias = Int64[Array, "n 2"]
OtherIndexPairs: TypeAlias = Int64[Array, "m 2"]
"""Pairs beside others of a different number."""
Labels: TypeAlias = Int32[Array, "n"]
GridIndex: TypeAlias = Int32[Array, "rows columns"]
Flags: TypeAlias = Bool[Array, "n"]
RaggedPoints2: TypeAlias = Float64[Array, "m 2"]
"""Rings of 2-D points one after the other."""
Splits: TypeAlias = Int64[Array, "splits"]
"""Where each ring of a ragged array starts, and the end of the last."""
