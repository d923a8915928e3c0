"""The methods that `register` offers, each with its options, as the union of methods in the numerics lists them."""

from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, get_args

from pydantic import Discriminator, Field, Tag

from algorithms.registration import DEFAULT_METHOD, RegistrationMethod
from schemas.requests.method_options import options_model
from schemas.values.base import RequestModel

METHODS: tuple[Any, ...] = get_args(RegistrationMethod) or (RegistrationMethod,)
"""Dataclasses of all methods; each carries its `name`."""

if TYPE_CHECKING:
    MethodRequest = RequestModel
    DefaultMethod = RequestModel
    MethodName: TypeAlias = str
else:
    _MODELS = {method: options_model(method, method.name) for method in METHODS}
    MethodRequest = Annotated[reduce(or_, _MODELS.values()), Field(discriminator="method")]
    DefaultMethod = _MODELS[DEFAULT_METHOD]
    MethodName = Literal[tuple(method.name for method in METHODS)]

ComparedMethod: TypeAlias = Annotated[
    Annotated[MethodName, Tag("name")] | Annotated[MethodRequest, Tag("options")],
    Discriminator(lambda value: "name" if isinstance(value, str) else "options"),
]
"""A method by its name alone, with its usual options, or with options as in `method`."""
