"""Options of the edge detection in photos and of the lines that come of it, as the numerics define them."""

from typing import TYPE_CHECKING

from algorithms.features.photo_lines.photo_line_options import PhotoLineOptions
from algorithms.photos.options import EdgeOptions
from schemas.requests.method_options import options_model
from schemas.values.base import RequestModel

if TYPE_CHECKING:
    EdgeOptionsRequest = RequestModel
    PhotoLineOptionsRequest = RequestModel
else:
    EdgeOptionsRequest = options_model(EdgeOptions)
    PhotoLineOptionsRequest = options_model(PhotoLineOptions)
