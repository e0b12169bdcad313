"""A ground station's parameter file fills in what a log does not tell."""

from __future__ import annotations

import pytest

from attlog.base.errors import LogUnreadable, UsageError
from attlog.flight import read
from attlog.flight.parameters.file import read_file

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


def test_all_bad_lines_are_told_at_once(tmp_path):
    path = tmp_path / "p.param"
    path.write_text("A,1\nB\nC,x\n\nD,2\nA,1\nD,3\n")
    with pytest.raises(UsageError) as refused:
        read_file(path)
    lines = str(refused.value).splitlines()
    assert [line.split("line ")[1].split(":")[0] for line in lines] == ["2", "3", "7"]
    assert lines[2].endswith("D is 3, in line 5 it was 2")
    path.write_text("".join(f"N{i},x\n" for i in range(20)))
    with pytest.raises(UsageError, match="14 more lines"):
        read_file(path)


@pytest.mark.parametrize("text", ["", "# nothing\n\n"])
def test_a_file_without_parameters_is_refused(tmp_path, text):
    path = tmp_path / "p.param"
    path.write_text(text)
    with pytest.raises(UsageError, match="holds no parameter"):
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


def test_what_differs_and_what_the_log_does_not_know_is_said(tmp_path, samples):
    path = tmp_path / "new.param"
    path.write_text("AHRS_RP_P,0.1\nAHRS_YAW_P,0.2\nAHRS_GPS_GAINN,1\nMY_OWN,7\n")
    log = read(samples / "copter_steps_stabilize.bin", params=path)
    found = {p.code: p for p in log.problems}
    assert "AHRS_RP_P 0.2 -> 0.1" in found["params_differ"].text
    assert "AHRS_YAW_P" not in found["params_differ"].text
    assert "AHRS_GPS_GAINN (did you mean AHRS_GPS_GAIN?), MY_OWN" in found["params_unknown"].text
    assert found["params_unknown"].severity == "warning"
    assert log.filled_params == {"AHRS_GPS_GAINN", "MY_OWN"}
    assert log.given_params["AHRS_RP_P"] == 0.1
    assert log.param("AHRS_RP_P") == pytest.approx(0.2)
    path.write_text("MY_OWN,7\n")
    assert {p.code: p.severity for p in read(log.path, params=path).problems}["params_unknown"] == "note"
    plain = {p.code for p in read(log.path).problems}
    assert not plain & {"params_differ", "params_unknown"}
