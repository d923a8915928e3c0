"""Lists of points as text tables: names, coordinates and what is known of their precision."""

import csv
import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Field, TypeAdapter, ValidationError
from pydantic_core import PydanticCustomError

from schemas.values.base import RequestModel
from schemas.values.harmless_texts import plain
from schemas.values.text_counts import too_many_cells
from schemas.values.texts_elsewhere import require_reading_here
from schemas.values.units import BY_NAME, unit_named, unit_words

ColumnName: TypeAlias = Literal["name", "x", "y", "z", "std", "std_x", "std_y", "std_z", "use", "-"]
MOST_ROWS = 100_000
SEPARATORS = ("\t", ";", ",")
COORDINATES = ("x", "y", "z")
KNOWN_COLUMNS: Mapping[str, str] = {
    **dict.fromkeys(("name", "id", "nr", "no", "number", "nummer", "point", "punkt", "pointid", "punktnr"), "name"),
    **dict.fromkeys(("x", "e", "east", "easting", "rechtswert", "ost"), "x"),
    **dict.fromkeys(("y", "n", "north", "northing", "hochwert", "nord"), "y"),
    **dict.fromkeys(("z", "h", "height", "elevation", "hohe", "höhe", "hoehe"), "z"),
    **dict.fromkeys(("std", "sigma", "s"), "std"),
    **{f"{word}{axis}": f"std_{axis}" for word in ("std", "sigma", "s", "m") for axis in COORDINATES},
    **{f"{axis}std": f"std_{axis}" for axis in COORDINATES},
    **dict.fromkeys(("use", "type", "verwendung"), "use"),
}  # fmt: skip
"""Names of columns, without case, blanks and signs, and what they hold. East is x, north y: a right-handed system."""
UNIT_BEHIND = re.compile(r"[\[(].*|_(mm|cm|m|ft|feet|us-ft|usft)$")
NUMBER = re.compile(r"[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?$")


class PointTable(RequestModel):
    """Points as the text of a table, one a line."""

    csv: Annotated[str, Field(min_length=1, max_length=20_000_000)]
    """The text. Values are separated by tabs, semicolons, commas or blanks; lines that begin with # are skipped."""
    columns: Annotated[list[ColumnName], Field(min_length=4, max_length=50)] | None = None
    """What the columns hold, `-` for what is not needed; null: as the first line names them, else name, x, y, z."""
    unit: Literal["m", "mm", "cm", "ft", "us-ft"] = "m"
    """Of coordinates and standard deviations, where names of columns do not state it as `X [mm]` or `s_x (mm)` do."""
    decimal: Literal[".", ","] | None = None
    """What separates decimals; null: found, or a point."""


def points_of_table(table: PointTable) -> list[dict[str, Any]]:
    """Read the points of a table.

    Returns
    -------
    One entry a point with `name`, `x`, `y`, `z` [m], and `std_m` (three numbers) and `use` where the table has them.

    Raises
    ------
    PydanticCustomError
        A column is not known or missing, a line has other columns than the first, or a value is no number, with lines.
    """
    if (what := too_many_cells(table.csv, "".join(SEPARATORS), 2 * MOST_ROWS)) is not None:
        raise _fault(what)
    rows = [(number, line) for number, line in enumerate(table.csv.lstrip("\ufeff").splitlines(), 1)
            if line.strip() and not line.lstrip().startswith("#")]  # fmt: skip
    if len(rows) > MOST_ROWS:
        raise _fault(f"the table has {len(rows)} lines, at most {MOST_ROWS} are read")
    if not rows:
        raise _fault("the table has no lines")
    decimal = table.decimal or _decimal(rows)
    cells = _cells(rows, decimal)
    columns, first = _columns(cells, table.columns)
    metres = _metres(columns, cells[0] if first else (0, [""] * len(columns)), table)
    return [_point(number, values, columns, decimal, metres) for number, values in cells[first:]]


def point_dictionaries(given: Any) -> Any:
    """Give the points of a table in place of it; what is no table goes through as it is."""
    if not isinstance(given, dict) or "csv" not in given:
        return given
    require_reading_here()
    try:
        table = TypeAdapter(PointTable).validate_python(given)
    except ValidationError as error:
        raise _fault("; ".join(f"{'/'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors())) from None
    return points_of_table(table)


def as_tuples(value: Any) -> Any:
    """Give tuples in place of arrays: behind a validator of its own a strict tuple takes no list."""
    return tuple(as_tuples(each) for each in value) if isinstance(value, list) else value


def _fault(what: str) -> PydanticCustomError:
    return PydanticCustomError("point_table", "{what}", {"what": what})


def _decimal(rows: Sequence[tuple[int, str]]) -> str:
    """Find the decimal separator: a comma where values are separated by something else, and no point is a decimal's."""
    text = "\n".join(line for _, line in rows[:1000])
    between = any(separator in text for separator in "\t;") or bool(re.search(r"\d\s+[-+]?\d", text))
    return "," if between and re.search(r"\d,\d", text) and not re.search(r"\d\.\d", text) else "."


def _cells(rows: Sequence[tuple[int, str]], decimal: str) -> list[tuple[int, list[str]]]:
    """Divide the lines by the separator that divides the first ones alike; names may hold others."""
    lines = [line for _, line in rows]
    possible = [each for each in SEPARATORS if each != decimal and any(each in line for line in lines[:10])]
    if possible:
        separator = next((each for each in possible if _divides_alike(lines[:10], each)), possible[0])
        divided = list(csv.reader(lines, delimiter=separator, skipinitialspace=True))
        return [(number, [v.strip() for v in values]) for (number, _), values in zip(rows, divided, strict=True)]
    return [(number, line.split()) for number, line in rows]


def _divides_alike(lines: Sequence[str], separator: str) -> bool:
    counts = {len(values) for values in csv.reader(lines, delimiter=separator, skipinitialspace=True)}
    return len(counts) == 1 and min(counts) >= 4


def _columns(cells: Sequence[tuple[int, list[str]]], stated: Sequence[ColumnName] | None) -> tuple[Sequence[str], int]:
    """Give what the columns hold, and the number of lines above the first point."""
    number, head = cells[0]
    is_head = len(head) >= 4 and not any(NUMBER.match(value) for value in head)
    if stated is not None:
        columns: list[str] = list(stated)
    elif is_head:
        words = [re.sub(r"[^a-zäöü]", "", re.sub(r"[\[(].*", "", value.lower())) for value in head]
        # a unit behind the name, such as x_m, says nothing of what it is
        plain = [re.sub(r"[^a-zäöü]", "", UNIT_BEHIND.sub("", value.lower())) for value in head]
        columns = [KNOWN_COLUMNS.get(w) or KNOWN_COLUMNS.get(p) or "-" for w, p in zip(words, plain, strict=True)]
    else:
        columns = ["name", "x", "y", "z"]
    for name in ("name", *COORDINATES):
        if columns.count(name) != 1:
            what = "no column" if name not in columns else "several columns"
            raise _fault(f"line {number}: {what} hold{'s' if name not in columns else ''} {name}; "
                         "name them in the first line or in `columns`")  # fmt: skip
    return columns, int(is_head)


def _metres(columns: Sequence[str], head: tuple[int, list[str]], table: PointTable) -> Mapping[str, float]:
    """Return the metres of one unit of each column: as its name says, as that of x says, or as `unit` states."""
    number, names = head
    found: dict[str, float] = {}
    for column, name in zip(columns, names, strict=True):
        words = unit_words(name) if column in COORDINATES or column.startswith("std") else ""
        if not words:
            continue
        unit = unit_named(words)
        if unit is None:
            raise _fault(f"line {number}: the unit {words!r} of the column {name!r} is none of length known here; "
                         f"known are {', '.join(BY_NAME)}")  # fmt: skip
        if "unit" in table.model_fields_set and column in COORDINATES and unit.name != table.unit:
            raise _fault(f"line {number}: the column {name!r} is in {unit.words}, `unit` says {table.unit}")
        found[column] = unit.metres
    usual = found.get("x", BY_NAME[table.unit].metres)
    return {column: found.get(column, usual) for column in columns}


def _point(
    number: int, values: Sequence[str], columns: Sequence[str], decimal: str, metres: Mapping[str, float]
) -> dict[str, Any]:
    if len(values) != len(columns):
        raise _fault(f"line {number}: {len(values)} values, and {len(columns)} columns")
    found = dict(zip(columns, values, strict=True))
    point: dict[str, Any] = {"name": plain(found["name"])}
    if not point["name"]:
        raise _fault(f"line {number}: the name is empty")

    def length(column: str) -> float:
        text = found[column]
        wrong = "," if decimal == "." else "."
        if wrong in text or not NUMBER.match(text):
            raise _fault(f"line {number}: {column} is {text!r}, no number with decimal {decimal!r}")
        return float(text.replace(",", ".")) * metres[column]

    for axis in COORDINATES:
        point[axis] = length(axis)
    if "std" in found:
        point["std_m"] = [length("std")] * 3
    elif {"std_x", "std_y", "std_z"} <= found.keys():
        point["std_m"] = [length("std_x"), length("std_y"), length("std_z")]
    if "use" in found:
        point["use"] = found["use"].lower()
    return point
