"""``attlog analyze --params``: what if the autopilot's filter had had these gains."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.conftest import few

SPELLINGS = {
    "mission planner": "# what if\nAHRS_RP_P,0.1\nINS_GYRO_FILTER,20\n",
    "qgroundcontrol": "# Vehicle Component Name Value Type\n1\t1\tAHRS_RP_P\t0.1\t9\n1\t1\tINS_GYRO_FILTER\t20\t4\n",
}


@pytest.mark.parametrize("text", few(SPELLINGS.values(), 1), ids=SPELLINGS.keys())
def test_the_file_overrides_the_log_for_the_autopilot_s_filter(attlog, samples, tmp_path: Path, text: str) -> None:
    """The row with the file's gain is the row with the gain as option; beside both the origin says whose it is."""
    params = tmp_path / "new.params"
    params.write_text(text)
    log = samples / "copter_yaw_turns.bin"
    row, by_option = "ap_dcm", "ap_dcm:AHRS_RP_P=0.1"
    common = ["--reference", "onboard:AHR2", "--gyro-bias", "none", "-q"]
    results = []
    for what, options in (
        ("file", ["--params", params, "--estimators", row]),
        ("log", ["--estimators", f"{row},{by_option}"]),
    ):
        out = tmp_path / what
        assert attlog("analyze", log, "-o", out, *common, *options).code == 0
        results.append(json.loads((out / "copter_yaw_turns.bin.json").read_text()))
    given = {e["name"]: e for e in results[0]["estimators"]}
    logged = {e["name"]: e for e in results[1]["estimators"]}
    assert given[row]["parameters"]["AHRS_RP_P"]["value"] == 0.1
    assert given[row]["parameters"]["AHRS_RP_P"]["origin"] == "file"
    assert given[row]["parameters"]["AHRS_YAW_P"]["origin"] == "log"
    assert logged[row]["parameters"]["AHRS_RP_P"]["origin"] == "log"
    assert logged[by_option]["parameters"]["AHRS_RP_P"]["origin"] == "option"
    tilt = "inclination_rmse_deg"
    a, b, c = (e["metrics"]["all"][tilt]["value"] for e in (given[row], logged[by_option], logged[row]))
    assert a == b
    assert a > 3 * c
    codes = {f["kind"] for f in results[0]["findings"]}
    assert "params_differ" in codes
    assert "params_differ" not in {f["kind"] for f in results[1]["findings"]}


def test_the_terminal_names_the_gain_that_is_not_the_log_s(attlog, samples, tmp_path: Path) -> None:
    params = tmp_path / "new.param"
    params.write_text("AHRS_RP_P,0.1\nAHRS_RP_PP,0.1\n")
    done = attlog(
        "analyze", samples / "copter_yaw_turns.bin", "-o", tmp_path, "--params", params, "--estimators", "ap_dcm", "-v"
    )
    assert done.code == 0
    assert "AP DCM (AHRS_RP_P 0.1)" in done.out
    assert "AHRS_RP_P 0.2 -> 0.1" in " ".join(done.out.split())
    assert "did you mean AHRS_RP_P?" in " ".join(done.out.split())


def test_a_bad_file_is_told_once_with_every_line_and_exit_code_2(attlog, samples, tmp_path: Path) -> None:
    params = tmp_path / "new.param"
    params.write_text("AHRS_RP_P\nAHRS_YAW_P,zero\n")
    log = samples / "copter_yaw_turns.bin"
    done = attlog("analyze", log, samples / "px4_hover.ulg", "-o", tmp_path / "r", "--params", params)
    assert done.code == 2
    assert done.err.count("line 1") == done.err.count("line 2") == 1
    assert not (tmp_path / "r").exists()
    assert attlog("analyze", log, "-o", tmp_path / "r", "--params", tmp_path / "none.param").code == 66
