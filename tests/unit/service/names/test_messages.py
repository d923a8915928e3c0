"""Every text exists in every language, and numbers are written as the language writes them."""

import string

import pytest

from service.names.messages.catalogue import LANGUAGES, all_messages, messages_in, preferred_language


def placeholders(text: str) -> set[str]:
    return {name for _, name, _, _ in string.Formatter().parse(text) if name is not None}


@pytest.mark.parametrize("key", sorted(all_messages()))
def test_a_message_exists_in_every_language_with_the_same_values(key: str) -> None:
    texts = all_messages()[key]
    assert set(texts) == set(LANGUAGES)
    assert all(text.strip() for text in texts.values())
    assert len({frozenset(placeholders(text)) for text in texts.values()}) == 1


def test_numbers_have_the_decimal_sign_of_the_language() -> None:
    assert messages_in("en").number(1.25, 2) == "1.25"
    assert messages_in("de").number(-1.25, 2) == "-1,25"
    assert [messages_in("en").number(value, 2) for value in (-0.004, -0.0, -0.006)] == ["0.00", "0.00", "-0.01"]
    assert messages_in("de").milli(0.00123, 2) == "1,23"
    assert messages_in("de").share(0.125) == "12,5 %"
    assert messages_in("en").milli(None) == messages_in("en").share(None) == "–"


def test_a_code_without_a_word_stands_for_itself() -> None:
    assert messages_in("de").word("status", "accepted") == "angenommen"
    assert messages_in("de").word("status", "never heard of") == "never heard of"


def test_a_missing_message_is_an_error() -> None:
    with pytest.raises(KeyError):
        messages_in("en")("no.such.text")


@pytest.mark.parametrize(
    ("header", "language"),
    [
        (None, "en"),
        ("", "en"),
        ("de", "de"),
        ("de-AT,de;q=0.9,en;q=0.5", "de"),
        ("fr, en;q=0.4, de;q=0.7", "de"),
        ("en-GB, de;q=0.9", "en"),
        ("de;q=0", "en"),
        ("ja, *;q=0.1, ;;;=, de;q=zero", "en"),
    ],
)
def test_the_browsers_language_is_taken_where_it_is_known(header: str | None, language: str) -> None:
    assert preferred_language(header) == language
