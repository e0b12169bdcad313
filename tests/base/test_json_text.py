"""The indented text is that of ``json.dumps``, byte for byte."""

from __future__ import annotations

import json
import signal
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from attlog.base.json_text import indented

LEAVES = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text()
TREES = st.recursive(
    LEAVES, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4), max_leaves=30
)


def by_json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, indent=1, allow_nan=False)


@given(TREES)
def test_the_text_is_that_of_json(value: Any) -> None:
    assert indented(value) == by_json(value)


def test_containers_within_containers_and_empty_ones_have_json_s_layout() -> None:
    value = {"a": {}, "b": [[], [1, [True, None]], {"µ": -0.0, 'x"\n\u2028\ud800': 1e300}], "c": 5e-324}
    assert indented(value) == by_json(value)
    assert [indented({}), indented([])] == ["{}", "[]"]


def test_numbers_and_text_of_other_types_are_written_as_json_writes_them() -> None:
    value = {"x": np.float64(0.1), "kind": signal.SIGINT, "name": type("Word", (str,), {})("a b")}
    assert indented(value) == by_json(value)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_numbers_that_are_not_finite_are_refused(value: float) -> None:
    with pytest.raises(ValueError, match="no number of JSON"):
        indented({"a": [value]})


@pytest.mark.parametrize("value", [np.arange(2), (1, 2), {1: 2}, b"x"])
def test_what_is_no_plain_value_is_refused(value: Any) -> None:
    with pytest.raises(TypeError):
        indented({"a": value})
