"""The methods that `register` offers, each with its options, as the union of methods in the numerics lists them."""

from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from pydantic import Field

from algorithms.registration import RegistrationMethod
from schemas.base import RequestModel
from schemas.method_options import options_model


class AutoMethod(RequestModel):
    """Let the service choose the method; its defaults hold."""

    method: Literal["auto"] = "auto"
    """Name of the method."""


METHODS: tuple[Any, ...] = get_args(RegistrationMethod) or (RegistrationMethod,)
"""Dataclasses of all methods; each carries its `name`."""

if TYPE_CHECKING:
    MethodRequest = RequestModel
else:
    _MODELS = [AutoMethod, *(options_model(method, method.name) for method in METHODS)]
    MethodRequest = Annotated[reduce(or_, _MODELS), Field(discriminator="method")]
