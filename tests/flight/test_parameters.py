"""Parameters over time, and what their defaults are."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from pyulog import ULog

from attlog import formats
from attlog.flight.builder import LogBuilder
from attlog.flight.parameters import ParameterHistory, add_values, parameter_histories, parameter_lines
from attlog.formats.recording import Recording
from attlog.formats.table import Messages, ParamChange
from attlog.pipeline.summary import describe_parameters
from attlog.result import Result
from attlog.words.parameters import parameter_lines as displayed
from tests.flight.fake import messages, micros

T0_US = 10_000_000
ROWS = {("x", 0): {"timestamp": micros(100, 10.0, T0_US)}}


def histories(opened: Messages, filled: frozenset[str] = frozenset()) -> dict[str, ParameterHistory]:
    builder = LogBuilder(opened, t0_us=T0_US)
    builder.log.parameters.lines = parameter_lines(builder, "made")
    builder.log.parameters.filled = filled
    add_values(builder, {})
    return {found.name: found for found in parameter_histories(builder.log)}


PX4 = [
    ParamChange("SET", 0.5),
    ParamChange("FRAME", 3.0),
    ParamChange("BOTH", 4.0),
    ParamChange("USUAL", 1.0),
    ParamChange("SET", 0.25, is_default=True),
    ParamChange("FRAME", 2.0, is_default=True, firmware_only=True),
    # the airframe has 5 where the firmware has 6, and the user 4
    ParamChange("BOTH", 5.0, is_default=True),
    ParamChange("BOTH", 6.0, is_default=True, firmware_only=True),
    ParamChange("USUAL", 1.5, T0_US + 2_000_000),
]


@pytest.mark.parametrize("through_a_file", [False, True])
def test_px4_logs_a_default_only_of_what_differs_from_it_and_tells_airframe_from_firmware(
    through_a_file: bool, tmp_path: Path
) -> None:
    opened = messages("ulog", ROWS, PX4)
    if through_a_file:
        columns = {key: dict(x) | {"x": np.zeros(100, np.float32)} for key, x in ROWS.items()}
        formats.write(tmp_path / "a.ulg", Recording(columns, PX4, [], {"sys_name": "PX4"}))
        theirs = ULog(str(tmp_path / "a.ulg"))
        assert theirs.get_default_parameters(0) == {"SET": 0.25, "FRAME": 2.0, "BOTH": 6.0}
        assert theirs.get_default_parameters(1) == {"SET": 0.25, "BOTH": 5.0}
        opened = formats.open(tmp_path / "a.ulg")
    found = histories(opened)
    assert {name: (one.value, one.default, one.origin) for name, one in found.items()} == {
        "SET": (0.5, 0.25, "set"),
        "FRAME": (3.0, 2.0, "airframe"),
        "BOTH": (4.0, 5.0, "set"),
        "USUAL": (1.0, 1.0, "default"),
    }
    ((t, value),) = found["USUAL"].changes
    assert value == 1.5
    assert t == pytest.approx(2.0, abs=0.11)  # a ULog's parameter has the time of the record before it


def test_a_log_without_defaults_leaves_them_unknown_and_a_file_fills_what_is_missing() -> None:
    changes = [ParamChange("A", 1.0), ParamChange("B", 2.0)]
    found = histories(messages("ulog", ROWS, changes), frozenset({"B"}))
    assert [(one.default, one.origin) for one in found.values()] == [(None, "unknown"), (None, "file")]


def test_values_before_the_first_sample_are_no_changes_and_repeated_ones_are_none() -> None:
    changes = [
        ParamChange("A", 1.0, T0_US - 5_000_000),
        ParamChange("A", 2.0, T0_US - 1_000_000),
        ParamChange("A", 2.0, T0_US + 1_000_000),
        ParamChange("A", 3.0, T0_US + 4_000_000),
        ParamChange("A", 2.0, T0_US + 6_000_000),
    ]
    (found,) = histories(messages("dataflash", ROWS, changes)).values()
    assert found.value == 2.0
    assert found.changes == [(4.0, 3.0), (6.0, 2.0)]


def test_a_value_first_logged_in_flight_is_no_change() -> None:
    (found,) = histories(messages("dataflash", ROWS, [ParamChange("A", 1.0, T0_US + 4_000_000)])).values()
    assert (found.value, found.changes) == (1.0, [])


@pytest.mark.parametrize(("log_format", "changes"), [("tlog", 2), ("dataflash", 4)])
def test_a_value_that_telemetry_repeats_rounded_is_no_change(log_format: str, changes: int) -> None:
    def later(name: str, *values: float) -> list[ParamChange]:
        return [ParamChange(name, value, T0_US + 1_000_000 * k) for k, value in enumerate(values)]

    sent = [*later("SMALL", 1.862886e-05, 1.86e-05), *later("LARGE", 96322.617, 96323.0)]
    sent += [*later("TUNED", 0.135, 0.14), *later("COUNT", 1_000_000, 1_000_001)]
    found = histories(messages(log_format, ROWS, sent))
    assert sum(len(one.changes) for one in found.values()) == changes
    assert found["TUNED"].changes
    assert found["COUNT"].changes


def test_parameters_of_a_json_result_keep_their_origin() -> None:
    """Those at their default are not in JSON."""
    builder = LogBuilder(messages("ulog", ROWS, PX4), t0_us=T0_US)
    builder.log.format = "ulog"
    builder.log.parameters.lines = parameter_lines(builder, "made")
    add_values(builder, {})
    lines = displayed(Result({}, "", {}, json.loads(json.dumps(describe_parameters(builder.log)))))
    assert {line.name: (line.kind, line.default) for line in lines} == {
        "SET": ("set", "0.25"),
        "FRAME": ("airframe", "2"),
        "BOTH": ("set", "5"),
        "USUAL": ("default", "1"),
    }
