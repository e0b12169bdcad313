"""A reason, written as a part of a sentence, as a sentence of its own."""

from __future__ import annotations


def as_sentence(reason: str) -> str:
    """With a capital and a full stop; a message's name at its beginning stays as the log writes it."""
    text = reason.rstrip(".")
    name = "_" in text.partition(" ")[0]
    return f"{text if name else text[:1].upper() + text[1:]}."
