"""A ground station's parameter file fills in what a log does not tell."""

from __future__ import annotations

import pytest

from attlog.errors import LogUnreadable, UsageError
from attlog.flight import read
from attlog.flight.parameter_file import read_file

SPELLINGS = {
    "mission_planner": "#NOTE: 2024\nAHRS_TRIM_X,0.01\nCOMPASS_DEC,-0.25\n",
    "mavproxy": "AHRS_TRIM_X      0.010000\nCOMPASS_DEC     -0.25 # east\n",
    "qgroundcontrol": "# Vehicle Component Name Value Type\n1\t1\tAHRS_TRIM_X\t0.01\t9\n1\t1\tCOMPASS_DEC\t-0.25\t9\n",
}


@pytest.mark.parametrize("text", SPELLINGS.values(), ids=SPELLINGS.keys())
def test_every_ground_station_is_understood(tmp_path, text):
    path = tmp_path / "p.param"
    path.write_text(text)
    assert read_file(path) == {"AHRS_TRIM_X": 0.01, "COMPASS_DEC": -0.25}


@pytest.mark.parametrize("line", ["ONLY_A_NAME", "A,b", "A,nan", "A,1,2"])
def test_a_line_that_is_no_parameter_is_told_with_its_number(tmp_path, line):
    path = tmp_path / "p.param"
    path.write_text(f"# first\n{line}\n")
    with pytest.raises(UsageError, match="line 2"):
        read_file(path)


def test_a_missing_file_is_told(tmp_path):
    with pytest.raises(LogUnreadable):
        read_file(tmp_path / "none.param")


def test_the_log_counts_where_it_holds_the_parameter_itself(tmp_path, samples):
    path = tmp_path / "p.param"
    path.write_text("AHRS_TRIM_X,0.5\nMY_OWN,7\n")
    log = samples / "copter_steps_stabilize.bin"
    plain, filled = read(log), read(log, params=path)
    assert plain.param("MY_OWN") is None
    assert filled.param("MY_OWN") == 7
    assert filled.params["AHRS_TRIM_X"].value == plain.params["AHRS_TRIM_X"].value
    assert 0.5 not in filled.params["AHRS_TRIM_X"].value
