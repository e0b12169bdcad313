"""Truth and replays of a flight, written as a user would and read back as rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from attlog.analysis import evaluate, prepare
from attlog.base import rotation
from attlog.metrics.base import Case
from attlog.result import EstimatorRow

FLIGHTS = ("px4/px4_steps.ulg", "ardupilot/copter_steps_stabilize.bin")


def written(path: Path, head: str, t: np.ndarray, x: np.ndarray) -> str:
    rows = [",".join(f"{v:.9f}" for v in (a, *b)) for a, b in zip(t, x, strict=True)]
    path.write_text("\n".join([head, *rows]) + "\n")
    return str(path)


def rows(case: Case, *specs: str) -> dict[str, EstimatorRow]:
    return {row.name: row for row in evaluate(case, ",".join(specs)).estimators}


@pytest.mark.parametrize("name", FLIGHTS)
def test_truth_as_a_file_has_no_lag_and_what_is_late_in_it_is_told(corpus: Path, tmp_path: Path, name: str) -> None:
    case = prepare(corpus / "sitl" / name)
    t, q = case.reference.t, case.reference.q
    files = [
        written(tmp_path / "quaternion.csv", "t,qw,qx,qy,qz", t, q),
        written(tmp_path / "euler.csv", "t,roll,pitch,yaw", t, np.degrees(rotation.to_euler(q))),
        written(tmp_path / "late.csv", "t,qw,qx,qy,qz", t + 0.02, q),
    ]
    found = rows(case, *files, files[2] + ":delay=20")
    for row, lag in {"quaternion": 0.0, "euler": 0.0, "late": 20.0, "late:delay=20": 0.0}.items():
        told = found[row].metrics["airborne"]["lag_ms"]
        assert told.value == pytest.approx(lag, abs=0.1)
        assert told.ci95[0] <= lag <= told.ci95[1]
        assert told.ranked
    for row in ("quaternion", "euler"):
        assert found[row].metrics["airborne"]["inclination_rmse_deg"].value < 0.001
        assert found[row].metrics["airborne"]["step_error_deg.0.5s"].value < 0.001


def test_a_replay_as_a_file_is_the_replay(corpus: Path, tmp_path: Path) -> None:
    from attlog.analysis.replay import run_rows

    case = prepare(corpus / "sitl" / FLIGHTS[1])
    row = run_rows(case, ["mahony"])[0]
    file = written(tmp_path / "again.csv", "time_s,q_w,q_x,q_y,q_z", row.t, row.q)
    delay = 1e3 * case.reference.input_delay_s
    found = rows(case, "mahony", f"{file}:delay={delay}")
    own, again = found["mahony"].metrics, found[f"again:delay={delay:g}"].metrics
    for window, metric in (
        ("airborne", "lag_ms"),
        ("airborne", "inclination_rmse_deg"),
        ("airborne", "heading_rmse_deg"),
        ("airborne", "step_error_deg.0.5s"),
        ("rest", "noise_tilt_deg"),
        ("cruise", "noise_tilt_deg"),
    ):
        assert again[window][metric].value == pytest.approx(own[window][metric].value, rel=1e-3), metric
