"""What stations may be called."""

from typing import Annotated, TypeAlias

from pydantic import Field

StationName: TypeAlias = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^\w[\w .()+-]*$")]
"""Letters, digits, `_`, blank, `.`, `(`, `)`, `+`, `-`; it names stations in results and downloads."""
