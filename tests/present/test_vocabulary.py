"""What people read of the sample logs uses the words of docs/nomenclature.md, in short sentences."""

from __future__ import annotations

import ast
import functools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import attlog
from attlog.base.plain import plain
from attlog.cli.shared.terminal import printed
from attlog.result import Result
from tests.conftest import SAMPLES

FORBIDDEN = re.compile(
    r"quick movement|told apart|\b(?:be|is|are|was|been|not) told\b|\bcannot tell\b|\btells? (?:which|whether|apart)|"
    r"taken off|takes off the gyro|attitude that flew|filter as it is|the wrong one|shown, not ranked|witness|hopeless|"
    r"\bwanders?\b|\bquieter\b|\bpieces\b|nursery|\blet go of\b"
)
ROOMS = (
    *("present", "story", "health", "compare", "fleet", "cli", "reproduce", "analysis", "metrics", "reference"),
    *("flight", "segments", "formats"),
)
"""Where strings are made that people read; what stands in pages is looked at in tests of pages."""
OWN_WORDS = ("Heading wander", "it does not wander, it is lost", "errors wander on every scale")
"""Of a metric that is called so."""
LONGEST = 18
"""Words of a sentence, or of what stands between semicolons; what stands in brackets does not count."""


@functools.cache
def analysed(name: str) -> Result:
    """A sample log with three filters and no figures."""
    return attlog.analyze(SAMPLES / name, {"estimators": ["mahony", "madgwick", "ekf12"]})


def texts(value: Any) -> Iterator[str]:
    """Every text in a document."""
    if isinstance(value, dict):
        for one in value.values():
            yield from texts(one)
    elif isinstance(value, list):
        for one in value:
            yield from texts(one)
    elif isinstance(value, str):
        yield value


def words(sentence: str) -> list[int]:
    """How many words each sentence or clause of a text has."""
    bare = re.sub(r"\s*\([^()]*\)", "", sentence)
    return [len(part.split()) for part in re.split(r"(?<=[.;])\s+", bare)]


def is_old(text: str) -> bool:
    """Whether a text has an old word that no metric is called by."""
    for own in OWN_WORDS:
        text = text.replace(own, "")
    return FORBIDDEN.search(text) is not None


def spoken(source: str) -> Iterator[str]:
    """Every string of several words in a file of Python that is no docstring."""
    tree = ast.parse(source)
    silent = {
        id(line.value)
        for node in ast.walk(tree)
        for line in (getattr(node, "body", None) if isinstance(getattr(node, "body", None), list) else ())
        if isinstance(line, ast.Expr)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in silent:
            yield from [node.value] if " " in node.value.strip() else []


@pytest.mark.parametrize("room", ROOMS)
def test_no_string_for_people_has_an_old_word(room: str) -> None:
    found = {
        f"{path.name}: {text}"
        for path in (Path(attlog.__file__).parent / room).rglob("*.py")
        for text in spoken(path.read_text(encoding="utf-8"))
        if is_old(text)
    }
    assert not found


@pytest.mark.parametrize("name", ["px4_steps.ulg", "copter_yaw_turns.bin"])
def test_old_words_stand_nowhere(name: str) -> None:
    result = analysed(name)
    document = plain(result) | {"definitions": result.definitions}
    lines = [line.text for line in printed(result, "all", 1000, "utf-8", verbose=True)]
    found = {text for text in (*texts(document), *lines) if is_old(text)}
    assert not found


@pytest.mark.parametrize("name", ["px4_steps.ulg", "copter_yaw_turns.bin"])
def test_sentences_of_the_answers_are_short(name: str) -> None:
    long = [v.sentence for v in analysed(name).verdicts if max(words(v.sentence)) > LONGEST]
    assert not long


def test_the_rule_finds_what_was_said_before() -> None:
    assert list(
        spoken('"""What is told."""\nx = "is told here"\ndef f():\n    "Not told."\n    return f"not told {x}"')
    ) == ["is told here", "not told "]
    assert FORBIDDEN.search("EKF12 and VQF wander least, not told apart: 0.05°.")
    assert FORBIDDEN.search("No gyro bias was taken off before the filters ran.")
    assert max(words("so " * LONGEST + "long.")) == LONGEST + 1
    assert words("A is closest (1.0 to 2.0 of many words). B is not; C is.") == [3, 3, 2]
