"""Options of the edge detection in photos, as the numerics define them."""

from typing import TYPE_CHECKING

from algorithms.photos.options import EdgeOptions
from schemas.base import RequestModel
from schemas.method_options import options_model

if TYPE_CHECKING:
    EdgeOptionsRequest = RequestModel
else:
    EdgeOptionsRequest = options_model(EdgeOptions)
