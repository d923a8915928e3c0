"""What files say of the instrument that measured a scan."""

from pydantic import ConfigDict

from schemas.values.base import ResponseModel


class InstrumentDocument(ResponseModel):
    """As the file states it (E57, LAS; other formats state nothing), checked by nobody; null: it does not say."""

    model_config = ConfigDict(extra="ignore", frozen=True, use_attribute_docstrings=True)

    make: str | None = None
    """Who made it."""
    model: str | None = None
    """Its type; of LAS what the file calls the system."""
    serial: str | None = None
    """Its serial number."""
    measured_from: str | None = None
    """Beginning of the measurement, UTC."""
    measured_to: str | None = None
    """End of the measurement, UTC."""
    file_date: str | None = None
    """Day on which the file was written; of LAS, which does not state the time of measurement."""


class MeasuringInstrument(InstrumentDocument):
    """What the file of a scan says of its instrument, in the result of a job."""
