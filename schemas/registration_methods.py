"""The methods that `register` offers, each with its options, as the union of methods in the numerics lists them."""

from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, get_args

from pydantic import Field

from algorithms.registration import DEFAULT_METHOD, RegistrationMethod
from schemas.base import RequestModel
from schemas.method_options import options_model

METHODS: tuple[Any, ...] = get_args(RegistrationMethod) or (RegistrationMethod,)
"""Dataclasses of all methods; each carries its `name`."""

if TYPE_CHECKING:
    MethodRequest = RequestModel
    DefaultMethod = RequestModel
else:
    _MODELS = {method: options_model(method, method.name) for method in METHODS}
    MethodRequest = Annotated[reduce(or_, _MODELS.values()), Field(discriminator="method")]
    DefaultMethod = _MODELS[DEFAULT_METHOD]
