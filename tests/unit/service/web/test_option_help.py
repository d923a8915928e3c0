"""What forms say in German of options is of the fields that there are, as their English help is now."""

from collections import defaultdict

import pytest

from service.processes import OFFERED_PROCESSES
from service.processes.adjust_strips import ADJUST_STRIPS
from service.processes.register import REGISTER
from service.web.option_help import described_fields, digest_of, option_words, translations

ENGLISH = described_fields(REGISTER)
GERMAN = translations("register", "de")
BESIDE_THE_OPTIONS = {"stations"}
"""Which the page of a new registration asks for otherwise."""
TRANSLATED = [process.id for process in (REGISTER, ADJUST_STRIPS)]


@pytest.mark.parametrize(
    ("process", "place"), [(process, place) for process in TRANSLATED for place in sorted(translations(process, "de"))]
)
def test_a_translation_is_of_the_help_as_it_is(process: str, place: str) -> None:
    """Where this fails, look at the German again and note the new digest."""
    english = described_fields(OFFERED_PROCESSES[process])
    assert (place, digest_of(english.get(place, ""))) == (place, translations(process, "de")[place]["of"])


def test_every_option_that_the_page_shows_first_has_german_help() -> None:
    shown = {place for place in ENGLISH if "." not in place and "[" not in place} - BESIDE_THE_OPTIONS
    assert shown - GERMAN.keys() == set()


@pytest.mark.parametrize("process", TRANSLATED)
def test_fields_of_one_name_have_one_label(process: str) -> None:
    labels = defaultdict(set)
    for place, entry in translations(process, "de").items():
        labels[place.split(".")[-1]].add(entry["label"])
    assert [name for name, known in labels.items() if len(known) > 1] == []


def test_help_is_found_by_the_english_that_the_form_has() -> None:
    words = option_words(REGISTER, "de")
    assert words["help"][ENGLISH["report.client"]] == "Wer die Vermessung bestellt hat."
    assert words["labels"]["client"] == "Auftraggeber"


def test_english_forms_need_no_other_words() -> None:
    assert option_words(REGISTER, "en") == {"labels": {}, "help": {}}
