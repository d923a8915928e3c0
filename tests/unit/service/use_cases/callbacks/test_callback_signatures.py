"""Signatures of callbacks, against the specification's example; and the pauses between attempts."""

import time
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError
from pydantic_core import PydanticCustomError

from schemas.requests.callback_secret import signing_key
from service.errors import InvalidRequestError
from service.keys_command import callback_secret
from service.settings import Settings
from service.use_cases.callbacks.callback_signatures import derived_secret, signed_headers
from service.use_cases.callbacks.deliver_callbacks import LONGEST_BACK_OFF_S, back_off_s

SECRET = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw"  # noqa: S105 - the published example


def test_the_example_of_the_specification_is_reproduced() -> None:
    body = [b'{"test": ', b"2432232314}"]
    headers = signed_headers(SECRET, "msg_p5jXN8AQM9LWM0D4loKWxJek", 1614265330, body)
    assert headers == {
        "webhook-id": "msg_p5jXN8AQM9LWM0D4loKWxJek",
        "webhook-timestamp": "1614265330",
        "webhook-signature": "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE=",
    }


def test_the_lines_of_the_documentation_tell_what_is_genuine() -> None:
    text = (Path(__file__).parents[5] / "service" / "CALLBACKS.md").read_text()
    code = text.partition("```python\n")[2].partition("```")[0]
    body, now = b'{"a": 1}', int(time.time())
    for at, content, genuine, fresh in ((now, body, True, True), (now, b"{}", False, True), (1, body, True, False)):
        headers = signed_headers(SECRET, "id", at, [content])
        found: dict[str, Any] = {"secret": SECRET, "headers": headers, "body": body}
        exec(code, found)  # noqa: S102 - our own documentation
        assert (found["genuine"], found["fresh"]) == (genuine, fresh)


def test_a_derived_secret_is_of_one_project_receiver_and_process() -> None:
    usual = derived_secret(SECRET, "office", "https://hooks.example.org/done?x=1", "register")
    assert usual == derived_secret(SECRET, "office", "https://HOOKS.example.org.:443/failed", "register")
    assert derived_secret(SECRET, "", "https://a.example", "register") == derived_secret(
        SECRET, "default", "https://a.example", "register"
    )
    others = {
        derived_secret("another secret, as long", "office", "https://hooks.example.org", "register"),
        derived_secret(SECRET, "alice", "https://hooks.example.org", "register"),
        derived_secret(SECRET, "office", "http://hooks.example.org", "register"),
        derived_secret(SECRET, "office", "https://hooks.example.org:8443", "register"),
        derived_secret(SECRET, "office", "https://other.example.org", "register"),
        derived_secret(SECRET, "office", "https://hooks.example.org", "detect-edges"),
        derived_secret(SECRET, "office\nhttps", "https://hooks.example.org", "register"),
    }
    assert len(others) == 7
    assert usual not in others
    assert signing_key(usual) != signing_key(SECRET)


@pytest.mark.parametrize("process", ["echo", "none"])
def test_the_operator_is_told_what_is_not_signed_in_his_name(process: str) -> None:
    settings = Settings(callback_secret=SECRET)
    assert callback_secret(settings, "https://a.example", "office", "register").startswith("whsec_")
    with pytest.raises(InvalidRequestError):
        callback_secret(settings, "https://a.example", "office", process)
    with pytest.raises(InvalidRequestError):
        callback_secret(settings, "a.example", "office", "register")
    with pytest.raises(InvalidRequestError):
        callback_secret(Settings(callback_secret=""), "https://a.example", "office", "register")


def test_nothing_is_signed_without_a_secret() -> None:
    assert signed_headers("", "id", 1, [b"x"]) == {"webhook-id": "id", "webhook-timestamp": "1"}


@pytest.mark.parametrize("change", [("other", 1, b"x"), ("id", 2, b"x"), ("id", 1, b"y"), ("id.1", 1, b"x")])
def test_id_time_and_body_are_signed(change: tuple[str, int, bytes]) -> None:
    delivery_id, timestamp, body = change
    first = signed_headers(SECRET, "id", 1, [b"x"])["webhook-signature"]
    assert signed_headers(SECRET, delivery_id, timestamp, [body])["webhook-signature"] != first


def test_a_secret_is_base64_after_its_prefix_and_otherwise_text() -> None:
    assert signing_key("whsec_" + "QUJDREVGR0hJSktMTU5PUA==") == b"ABCDEFGHIJKLMNOP"
    assert signing_key("sixteen letters!") == b"sixteen letters!"


@pytest.mark.parametrize("secret", ["short", "whsec_QUJD", "whsec_not base64 at all", "whsec_", ""])
def test_a_secret_that_can_be_guessed_or_is_no_base64_is_refused(secret: str) -> None:
    with pytest.raises(PydanticCustomError):
        signing_key(secret)


def test_the_secret_of_the_service_is_checked_when_it_starts() -> None:
    assert Settings(callback_secret="").callback_secret == ""
    assert Settings(callback_secret=SECRET).callback_secret == SECRET
    with pytest.raises(ValidationError, match="base64"):
        Settings(callback_secret="whsec_?")  # noqa: S106 - none


def test_pauses_double_up_to_an_hour() -> None:
    assert [back_off_s(attempt, 5.0, 1.0) for attempt in (1, 2, 3, 10, 11, 1000)] == [
        *(5.0, 10.0, 20.0, 2560.0),
        *(LONGEST_BACK_OFF_S, LONGEST_BACK_OFF_S),
    ]


def test_pauses_are_spread() -> None:
    assert back_off_s(3, 5.0, 0.5) == 10.0
