"""A log in a few lines."""

from __future__ import annotations

import numpy as np

from attlog.analysis import summary
from attlog.flight.model import TimeLine
from tests.reference.flights import flight


def test_a_parameter_that_was_set_in_flight_is_told_with_its_last_value_where_that_is_not_the_default() -> None:
    log = flight()
    values = {"SET": [1.0, 3.0], "BACK": [3.0, 1.0], "SAME": [1.0], "OTHER": [2.0]}
    log.params = {name: TimeLine(np.arange(len(v), dtype=float), v, "PARM") for name, v in values.items()}
    log.param_defaults = dict.fromkeys(("SET", "BACK", "SAME"), 1.0)
    assert summary._changed(log) == {"SET": [3.0, 1.0]}


def test_parameters_are_listed_that_differ_from_their_default_or_all_where_the_log_tells_none() -> None:
    log = flight()
    values = {"OWN": [2.0], "SAME": [1.0], "UNTOLD": [5.0], "FILE": [6.0]}
    log.params = {name: TimeLine(np.arange(len(v), dtype=float), v, "PARM") for name, v in values.items()}
    assert list(summary._params(log)) == ["FILE", "OWN", "SAME", "UNTOLD"]
    log.param_defaults = dict.fromkeys(("OWN", "SAME"), 1.0)
    log.filled_params = frozenset({"FILE"})  # no default of the log's is that of the file
    assert summary._params(log) == {"FILE": 6.0, "OWN": 2.0}
