"""The texts of the viewer, which the page that shows it hands to its scripts."""

from service.names.messages.catalogue import Messages

CODES = ("status", "station", "feature", "source", "use", "point-state")
"""Subjects of which scripts write codes as words."""


def viewer_words(t: Messages) -> dict[str, str]:
    """Give what the viewer says in a language: its own texts, words of codes as ``status.accepted``, the language."""
    codes = {f"{subject}.{code}": text for subject in CODES for code, text in t.below(subject).items()}
    return {**t.below("viewer"), **codes, "language.code": t.language}
