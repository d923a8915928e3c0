"""What one file may ask for while it is read."""

from service.formats.base import ReadLimits
from service.ports import StepContext


def read_limits(context: StepContext) -> ReadLimits:
    """Give what one file may ask for, from the settings."""
    return ReadLimits(max_points=context.limits["max_points"], max_pixels=context.limits["max_photo_pixels"])
