"""``attlog tune``: files, exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from attlog.estimators import get
from tests.conftest import SAMPLES

LOGS = (SAMPLES / "px4_steps.ulg", SAMPLES / "copter_yaw_turns.bin")


@pytest.mark.slow
def test_gains_come_with_page_and_json_and_the_same_again(
    attlog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("attlog.compare.tune.tune.GENERATIONS", 1)
    arguments = (*LOGS, "mahony", "kp=0.1..2log", "--objective", "tilt")
    done = attlog("tune", *arguments, "-o", tmp_path)
    assert done.code == 0, done.err
    assert "mahony:kp=" in done.out
    assert {p.name for p in tmp_path.iterdir()} == {"tune-mahony.html", "tune-mahony.json"}
    found = json.loads((tmp_path / "tune-mahony.json").read_text())
    assert found["as_it_is"] == {"kp": next(p.default for p in get("mahony").own if p.name == "kp")}
    assert [f["left_out"] for f in found["folds"]] == [["px4_steps.ulg"], ["copter_yaw_turns.bin"]]
    again = json.loads(attlog("tune", *arguments, "-o", tmp_path, "--json", "-q").out)
    assert again["gains"] == found["gains"]
    assert again["tried"] == found["tried"]


def test_wrong_usage_is_2_with_everything_that_is_wrong(attlog, tmp_path: Path) -> None:
    for arguments, words in (
        ((*LOGS, "mahony", "kp=1", "--objective", "tild=1"), ("give a range", "mean tilt")),
        ((*LOGS, "mahonny"), ("mean mahony",)),
        ((LOGS[0],), ("filter",)),
        ((*LOGS, "gyro"), ("no gains",)),
    ):
        done = attlog("tune", *arguments, "-o", tmp_path)
        assert (done.code, done.out) == (2, ""), (arguments, done)
        assert all(word in done.err for word in words), (arguments, done.err)


def test_logs_that_cannot_answer_are_65(attlog, tmp_path: Path) -> None:
    done = attlog("tune", LOGS[0], "mahony", "kp=0.1..2log", "--objective", "noise_tilt_deg@idle", "-o", tmp_path)
    assert (done.code, "are needed" in done.err) == (65, True), done
