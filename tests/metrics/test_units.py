import pickle

import numpy as np
import pytest

from attlog.metrics.answer import Answer
from attlog.metrics.units import Summary, UnitValues, ids_of
from attlog.plain import plain


def mean_of(ids):
    return Summary(float(len(ids)), None)


UNITS = UnitValues("slope_group", ids_of([5.0, 0.0004, 9.9999]), np.array([2.0, 1.0, 3.0]), mean_of)


def test_units_are_found_by_the_millisecond_they_begin_at():
    np.testing.assert_array_equal(UNITS.at(ids_of([0.0, 10.0])), [1.0, 3.0])
    with pytest.raises(KeyError, match="7000"):
        UNITS.at(ids_of([7.0, 10.0]))


def test_units_travel_between_processes_but_not_into_the_json():
    answer = Answer(1.0, "deg", "all", units=UNITS)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(answer)).units.values, UNITS.values)
    assert "units" not in plain(answer)
