"""``--truth``: what a user brings is the reference in every command that compares; what is wrong with it is said."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog import formats
from attlog.core import rotation
from attlog.flight import read
from tests.conftest import SAMPLES, few

LOG = SAMPLES / "px4_steps.ulg"
LATE_S = 1234.5
BODY, WORLD = rotation.from_euler(0.1, -0.2, 2.0), rotation.from_euler(np.pi, 0.0, 1.0)


@pytest.fixture(scope="module")
def mocap(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The simulator's truth as a laboratory would have measured it: another clock, other axes, a little noise."""
    truth = read(LOG).truth
    assert truth is not None
    t = truth.t if truth.t_sample is None else truth.t_sample
    noise = rotation.from_rotvec(np.radians(0.05) * np.random.default_rng(0).normal(size=(len(t), 3)))
    q = rotation.multiply(WORLD, rotation.multiply(rotation.multiply(truth.q, noise), BODY))
    path = tmp_path_factory.mktemp("truths") / "px4_steps.tum"
    rows = np.column_stack([t + LATE_S, np.zeros((len(t), 3)), q[:, 1:], q[:, :1]])
    path.write_text("\n".join(" ".join(f"{x:.9f}" for x in row) for row in rows))
    return path


@pytest.mark.slow
def test_analyze_compares_with_it_and_tells_how_it_was_aligned(attlog: Any, mocap: Path, tmp_path: Path) -> None:
    rows = ("--estimators", "mahony,mekf")
    done = attlog("analyze", str(LOG), "--truth", str(mocap), *rows, "-o", str(tmp_path))
    assert done.code == 0
    assert "Against your truth" in done.out
    found = json.loads((tmp_path / "px4_steps.ulg.json").read_text())["reference"]
    assert (found["choice"], found["source"], found["heading_by"]) == ("truth", "px4_steps.tum", "relative")
    assert found["fit"]["offset_s"] == pytest.approx(-LATE_S, abs=0.005)
    assert found["fit"]["body_deg"] == pytest.approx(np.degrees(rotation.to_euler(BODY)), abs=0.5)
    assert 0.0 < found["sigma_tilt_deg"] < 2.0
    page = (tmp_path / "px4_steps.ulg.html").read_text()
    assert "compared with your truth (px4_steps.tum)" in page


@pytest.mark.slow
@pytest.mark.parametrize("words", [("compare", "mahony", "mekf"), ("sweep", "mahony", "kp=0.3,0.6")])
def test_the_commands_that_compare_take_one_too_also_of_a_folder(
    attlog: Any, mocap: Path, tmp_path: Path, words: tuple[str, ...]
) -> None:
    command, *rest = words
    done = attlog(command, str(LOG), *rest, "--truth", str(mocap.parent), "-o", str(tmp_path))
    assert done.code == 0, done.err
    made = json.loads(next(tmp_path.glob("*.json")).read_text())
    assert made["logs"][0]["reference"].startswith("truth")


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("--truth", "nowhere.tum"), 66, "nowhere.tum: no such file"),
        (("--truth", "vehicle_mocap_odometry"), 2, "it holds vehicle_attitude"),
        (("--truth", "gnss_yaw"), 2, "no receiver of px4_steps.ulg tells a heading of two antennas"),
        (("--truth", "vehicle_attitude:ofset=3"), 2, "did you mean offset=?"),
        (("--truth", "vehicle_attitude", "--reference", "onboard"), 2, "leave out one of the two"),
    ],
)
def test_what_is_wrong_with_it_is_said(
    attlog: Any, tmp_path: Path, words: tuple[str, ...], code: int, said: str
) -> None:
    done = attlog("analyze", str(LOG), *words, "-o", str(tmp_path))
    assert done.code == code
    assert said in done.err
    assert not list(tmp_path.iterdir())


# ``attlog analyze --params``: what if the autopilot's filter had had these gains.

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
    tilt = "tilt_rmse_deg"
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


def planted(log: Path, path: Path, milligauss: tuple[int, int, int]) -> None:
    """A copy of an ArduPilot log whose first compass read so much more, as with wrong COMPASS_OFS (``QBhhh...``)."""
    raw = np.frombuffer(log.read_bytes(), np.uint8).copy()
    table = formats.open(log)["MAG", 0]
    for axis, (column, more) in enumerate(zip(("MagX", "MagY", "MagZ"), milligauss, strict=True)):
        at = np.asarray(table.offsets)[:, None] + 3 + 8 + 1 + 2 * axis + np.arange(2)
        assert (raw[at].view("<i2")[:, 0] == table[column]).all()
        raw[at] = (table[column] + more).astype("<i2")[:, None].view(np.uint8)
    path.write_bytes(raw.tobytes())


@pytest.mark.slow
def test_a_file_with_the_right_offsets_lowers_the_heading_error(attlog, samples: Path, tmp_path: Path) -> None:
    """Planted 130 mG; COMPASS_OFS of the file is lower by what was planted: the error is that of the sound log."""
    sound, wrong, file = samples / "copter_yaw_turns.bin", tmp_path / "wrong.bin", tmp_path / "new.param"
    planted(sound, wrong, (90, -80, 50))
    file.write_text("COMPASS_OFS_X,-85\nCOMPASS_OFS_Y,93\nCOMPASS_OFS_Z,-68\n")
    errors = []
    for log, options in ((sound, []), (wrong, []), (wrong, ["--params", file])):
        out = tmp_path / str(len(errors))
        assert attlog("analyze", log, "-o", out, "-q", "--estimators", "mahony", *options).code == 0
        result = json.loads(next(out.glob("*.json")).read_text())
        row = next(e for e in result["estimators"] if e["name"] == "mahony")
        errors.append(row["metrics"]["airborne"]["heading_rmse_deg"]["value"])
    assert errors[1] > 3 * errors[0]
    assert errors[2] == pytest.approx(errors[0], abs=0.05)
    assert "calibration_applied" in {f["kind"] for f in result["findings"]}
