import json
import math
import pickle

import numpy as np
import pytest
from pydantic import TypeAdapter

from attlog.base.plain import plain
from attlog.metrics.answer import Answer
from attlog.metrics.statistics.units import Kind, Summary, UnitValues, ids_of


def mean_of(ids):
    return Summary(float(len(ids)), None)


UNITS = UnitValues("slope_group", ids_of([5.0, 0.0004, 9.9999]), np.array([2.0, 1.0, 3.0]), mean_of)


def test_units_are_found_by_the_millisecond_they_begin_at():
    np.testing.assert_array_equal(UNITS.at(ids_of([0.0, 10.0])), [1.0, 3.0])
    with pytest.raises(KeyError, match="7000"):
        UNITS.at(ids_of([7.0, 10.0]))


def test_units_travel_between_processes_and_in_the_json_without_the_function() -> None:
    answer = Answer(1.0, "deg", "all", units=UNITS)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(answer)).units.values, UNITS.values)
    document = json.loads(json.dumps(plain(answer)))
    assert document["units"] == {"kind": "slope_group", "ids": [5000, 0, 10000], "values": [2.0, 1.0, 3.0]}
    back = TypeAdapter(Answer).validate_python(document, strict=False)
    assert back.units is not None
    assert back.units.ids.dtype == np.int64
    np.testing.assert_array_equal(back.units.at(ids_of([10.0, 5.0])), [3.0, 2.0])


@pytest.mark.parametrize(
    ("kind", "values", "expected"),
    [
        ("log_variance", [math.log(0.01), math.log(0.04)], math.sqrt(0.02)),  # the geometric mean of 0.1 and 0.2
        ("mean_square", [1.0, 7.0], 2.0),
        ("lag_event", [4.0, 6.0], 5.0),
        ("slope_group", [-1.0, 4.0], 1.5),
        ("step_event", [1.0, 2.0, 9.0], 2.0),
    ],
)
def test_units_from_a_file_are_summed_up_by_their_kind(kind: Kind, values: list[float], expected: float) -> None:
    ids = ids_of(np.arange(len(values) + 1))
    units = UnitValues(kind, ids, np.array([*values, 99.0]))
    assert units.of(ids[:-1]).value == pytest.approx(expected)


def test_a_value_that_is_no_number_is_written_as_null() -> None:
    units = UnitValues("lag_event", ids_of([0.0, 1.0]), np.array([1 / 3, math.nan]))
    assert plain(units)["values"] == [1 / 3, None]
