"""Check whom a job is to tell how it goes, before there is a job."""

import asyncio

from schemas.requests.subscriber import Subscriber
from service.errors import AddressRefusedError, FieldFault, InvalidRequestError
from service.ports import CallbackEvent, CallbackSender, Subscription
from service.settings import Settings
from service.use_cases.access.sealed_secrets import seal_of
from service.use_cases.inputs.validate_request import WRONG_FIELDS, pointer_to

NO_SECRETS = (
    "this service keeps no secrets, because it has no key to encrypt them: leave it out, or ask the operator to set "
    "TIELINE_CALLBACK_SECRET"
)


async def checked_subscription(
    subscriber: Subscriber, callbacks: CallbackSender, base_url: str, settings: Settings
) -> Subscription:
    """Give the subscription that a request asks for.

    Parameters
    ----------
    subscriber
        Of the request.
    callbacks
        Knows which addresses are allowed.
    base_url
        Beginning of the links in what is told.
    settings
        Tell whether a secret can be kept.

    Raises
    ------
    InvalidRequestError
        With a pointer to every address to which nothing may be sent, and to a secret that cannot be kept.
    """
    uris = {
        CallbackEvent.SUCCESS: subscriber.success_uri,
        CallbackEvent.IN_PROGRESS: subscriber.in_progress_uri,
        CallbackEvent.FAILED: subscriber.failed_uri,
    }
    wanted = {event: uri for event, uri in uris.items() if uri is not None}
    found = await asyncio.gather(*(_fault(event, uri, callbacks) for event, uri in wanted.items()))
    faults = [fault for fault in found if fault is not None]
    if subscriber.secret and seal_of(settings) is None:
        faults.append(FieldFault(pointer_to("subscriber", "secret"), NO_SECRETS))
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)
    return Subscription(wanted, subscriber.secret or "", base_url)


async def _fault(event: CallbackEvent, uri: str, callbacks: CallbackSender) -> FieldFault | None:
    try:
        await callbacks.check(uri)
    except AddressRefusedError as error:
        return FieldFault(pointer_to("subscriber", f"{event.value}Uri"), str(error))
    return None
