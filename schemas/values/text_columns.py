"""What the columns of a table of points are, in one line: `row,col,x,y,z,i`."""

import re
from collections.abc import Sequence
from typing import Annotated, TypeAlias

from pydantic import AfterValidator, Field

ROLES = {
    **dict.fromkeys(("x", "easting", "east", "e", "rechtswert", "ostwert"), "x"),
    **dict.fromkeys(("y", "northing", "north", "n", "hochwert", "nordwert"), "y"),
    **dict.fromkeys(("z", "height", "elevation", "h", "hoehe"), "z"),
    **dict.fromkeys(("intensity", "i", "reflectance", "scalar_intensity", "amplitude"), "i"),
    **dict.fromkeys(("r", "red"), "r"),
    **dict.fromkeys(("g", "green"), "g"),
    **dict.fromkeys(("b", "blue"), "b"),
}
"""Name of a column, lower case -> what it is; columns of other names are passed over."""
PASSED_OVER = "-"
TEXT_ENDINGS = (".xyz", ".pts", ".csv", ".txt", ".asc")
"""Of the names of files that hold tables."""
LONGEST = 1000
MOST_COLUMNS = 100
WHOLE_NUMBERS = frozenset(("row", "col", "column", "line", "ring", "number", "id", "point"))
"""Names of columns that hold whole numbers, or words."""
HOW = (
    "say what the columns are, such as `row,col,x,y,z,i`: in the form field or the tus metadata `columns`, in the "
    "header `Tieline-Columns`, or with `--columns`; columns that are passed over may have any other name"
)


def column_names(text: str) -> list[str]:
    """Split a statement at commas, semicolons or blanks."""
    return re.split(r"[,;]|\s+", re.sub(r"\s*([,;])\s*", r"\1", text.strip()))


def roles_of(names: Sequence[str]) -> list[str]:
    """Tell what each column is by its name: x, y, z, i, r, g, b, or `-` for one that is passed over.

    `[m]` and `(m)` behind a name count for nothing, nor do quotation marks. Where a column is called x, y or z itself,
    others that may mean the same (such as `n` for northing, or for a number) are passed over.
    """
    plain = [re.sub(r"[\[(].*", "", name.strip("\"' ").lower()).strip("\"' ") for name in names]
    plain = [re.sub(r"_(mm|cm|m|ft|feet|us-ft|usft)$", "", name) for name in plain]
    roles = [ROLES.get(name, PASSED_OVER) for name in plain]
    literal = {axis for axis in "xyz" if axis in plain}
    return [PASSED_OVER if role in literal and name != role else role for role, name in zip(roles, plain, strict=True)]


def checked_columns(text: str) -> str:
    """Give a statement in its shortest form, after having checked it.

    Raises
    ------
    ValueError
        It names no x, y or z, or one of them twice; or it is longer than any table.
    """
    names = column_names(text)
    if len(text) > LONGEST or len(names) > MOST_COLUMNS:
        raise ValueError(f"at most {MOST_COLUMNS} columns and {LONGEST} characters are understood")
    if any(not name for name in names) or not all(name.isprintable() for name in names):
        raise ValueError(f"'{text[:60]}' has a column without a name; one that is passed over may be called `-`")
    roles = roles_of(names)
    missing = [axis for axis in "xyz" if axis not in roles]
    if missing:
        raise ValueError(
            f"'{text[:60]}' names no column {' and no column '.join(missing)}; an example: `row,col,x,y,z,i`"
        )
    for role in sorted(set(roles) - {PASSED_OVER}):
        if roles.count(role) > 1:
            twice = " and ".join(f"{k + 1} ('{names[k]}')" for k, each in enumerate(roles) if each == role)
            raise ValueError(f"columns {twice} are both {role}")
    colours = [role for role in "rgb" if role in roles]
    if 0 < len(colours) < 3:
        raise ValueError(f"'{text[:60]}' names {' and '.join(colours)}, but a colour needs r, g and b")
    return ",".join(
        role if role != PASSED_OVER else name if name in WHOLE_NUMBERS else PASSED_OVER
        for role, name in zip(roles, (name.lower() for name in names), strict=True)
    )


StatedColumns: TypeAlias = Annotated[str, Field(min_length=5, max_length=LONGEST), AfterValidator(checked_columns)]
