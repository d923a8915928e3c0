"""What a client says that the columns of a text table are, checked at the door."""

from schemas.values.text_columns import checked_columns
from service.errors import FieldFault, InvalidRequestError
from service.use_cases.inputs.validate_request import pointer_to

FIELD, HEADER = "columns", "Tieline-Columns"


def stated_columns(text: str, where: str = FIELD) -> str:
    """Give the statement in its shortest form; empty where nothing was said.

    Raises
    ------
    InvalidRequestError
        It cannot be.
    """
    if not text.strip():
        return ""
    try:
        return checked_columns(text)
    except ValueError as error:
        raise InvalidRequestError(f"{where}: {error}", [FieldFault(pointer_to(where), str(error))]) from None
