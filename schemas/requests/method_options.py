"""Request models from option dataclasses of `algorithms`, so that every option is written once."""

import ast
import inspect
import textwrap
from dataclasses import MISSING, Field, asdict, fields, is_dataclass
from functools import cache
from typing import Any, Literal, get_type_hints

from pydantic import BaseModel, ConfigDict, create_model
from pydantic import Field as ModelField

from schemas.values.base import RequestModel


class OptionsModel(RequestModel):
    """Leave docstrings alone, which were read already: pydantic would look for the source of a class that has none."""

    model_config = ConfigDict(use_attribute_docstrings=False)


@cache
def options_model(options: type[Any], method: str | None = None) -> type[BaseModel]:
    """Build the request model of an option dataclass.

    Names, types, bounds (`annotated_types` in `Annotated`), defaults and the docstrings below the fields are taken
    over; nested option dataclasses become nested models; unknown fields are refused.

    Parameters
    ----------
    options
        A frozen dataclass whose fields are the options.
    method
        Name that selects it in a request (field `method`); None for options that need no such name.
    """
    hints = get_type_hints(options, include_extras=True)
    docs = _field_docs(options)
    members: dict[str, Any] = {}
    if method is not None:
        members["method"] = (Literal[method], ModelField(default=method, description="Name of the method."))
    for option in fields(options):
        if not option.init:
            continue
        kind = hints[option.name]
        if is_dataclass(kind) and isinstance(kind, type):
            nested = options_model(kind)
            default = _nested_default(option, kind, nested)
            members[option.name] = (nested, ModelField(default=default, description=docs.get(option.name)))
        else:
            members[option.name] = (kind, ModelField(description=docs.get(option.name), **_default(option)))
    return create_model(
        f"{options.__name__.removesuffix('Options')}Options",
        __base__=OptionsModel,
        __doc__=inspect.getdoc(options),
        **members,
    )


def _default(option: Field[Any]) -> dict[str, Any]:
    if option.default is not MISSING:
        return {"default": option.default}
    if option.default_factory is not MISSING:
        return {"default_factory": option.default_factory}
    return {}


def _nested_default(option: Field[Any], kind: type[Any], nested: type[BaseModel]) -> BaseModel:
    if option.default is not MISSING:
        default = option.default
    elif option.default_factory is not MISSING:
        default = option.default_factory()
    else:
        default = kind()
    return nested.model_validate(asdict(default))


def _field_docs(options: type[Any]) -> dict[str, str]:
    """Read the docstrings that stand below the fields of a class and of those it inherits from."""
    docs: dict[str, str] = {}
    for each in reversed([c for c in options.__mro__ if is_dataclass(c)]):
        body = ast.parse(textwrap.dedent(inspect.getsource(each))).body[0]
        if not isinstance(body, ast.ClassDef):
            continue
        for statement, below in zip(body.body, body.body[1:], strict=False):
            if (
                isinstance(statement, ast.AnnAssign)
                and isinstance(statement.target, ast.Name)
                and isinstance(below, ast.Expr)
                and isinstance(below.value, ast.Constant)
                and isinstance(below.value.value, str)
            ):
                docs[statement.target.id] = inspect.cleandoc(below.value.value)
    return docs
