"""Settings on one log: the same answers as one by one, asked once."""

from __future__ import annotations

from pathlib import Path

import pytest

import attlog
from attlog.analysis import replay
from attlog.base.errors import UsageError
from attlog.compare.configurations.configuration import parse
from attlog.compare.sweep.many import SettingsOnLog, wanted
from attlog.metrics.base import Case
from tests.conftest import SAMPLES

ASKED = ("inclination_rmse_deg", "heading_median_deg", "noise_tilt_deg", "step_error_deg.0.5s@airborne")
SETTINGS = [{"kp": 0.3, "ki": 0.0}, {"kp": 0.9, "ki": 0.02}, {"kp": 2.0, "ki": 0.0, "mag_form": "vector"}]


@pytest.fixture(scope="module")
def case() -> Case:
    return attlog.prepare(SAMPLES / "px4_steps.ulg")


def test_a_batch_answers_what_single_runs_answer(case: Case) -> None:
    asked = wanted(ASKED)
    many = SettingsOnLog(case, parse("mahony"), asked)(SETTINGS)
    names = ["mahony:" + ",".join(f"{k}={v}" for k, v in s.items()) for s in SETTINGS]
    alone = attlog.evaluate(case, names).estimators
    for settled, row in zip(many, [r for r in alone if r.kind == "replay"], strict=True):
        assert settled.status == row.status
        for metric in asked:
            mine, own = settled.answers[metric], row.metrics[metric.window][metric.metric]
            assert mine.value is not None
            assert mine.value == pytest.approx(own.value, rel=1e-9)
            assert mine.ci95 == pytest.approx(own.ci95, rel=1e-9)


def test_what_comes_before_the_filter_comes_before_every_setting(case: Case) -> None:
    asked = wanted(["inclination_rmse_deg"])
    plain, filtered = (SettingsOnLog(case, parse(c), asked)(SETTINGS[:1])[0] for c in ("mahony", "mahony:latency=50"))
    assert plain.answers[asked[0]].value != filtered.answers[asked[0]].value


def test_a_setting_is_run_once(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[int] = []
    batch = replay.batch
    monkeypatch.setattr(replay, "batch", lambda *a: ran.append(len(a[4])) or batch(*a))
    on = SettingsOnLog(case, parse("mahony"), wanted(["inclination_rmse_deg"]))
    first = on([SETTINGS[0], SETTINGS[0], SETTINGS[1]])
    again = on([SETTINGS[1], SETTINGS[0]])
    assert sum(ran) == 2
    assert first[0] is first[1] is again[1]


def test_a_filter_that_gravity_does_not_correct_may_win_nothing(case: Case) -> None:
    on = SettingsOnLog(case, parse("mahony"), wanted(["inclination_rmse_deg"]))
    assert "gravity" in on.why_not_best({"kp": 0.0, "ki": 0.0})
    assert on.why_not_best({"kp": 0.5}) == ""


def test_everything_wrong_with_the_metrics_is_told_at_once() -> None:
    with pytest.raises(UsageError) as refused:
        wanted(["inclination_rms_deg", "lag_ms@", "cost_ns"])
    said = str(refused.value)
    assert "did you mean inclination_rmse_deg" in said
    assert "no window" in said
    assert "cost_ns" in said
    assert [w.name for w in wanted(["noise_tilt_deg@hover", "noise_tilt_deg@hover", "lag_ms"])] == [
        "noise_tilt_deg@hover",
        "lag_ms",
    ]


def test_a_window_that_is_none_is_refused(case: Case) -> None:
    with pytest.raises(UsageError, match="noise_tilt_deg@flight"):
        SettingsOnLog(case, parse("mahony"), wanted(["noise_tilt_deg@flight"]))


def test_a_filter_that_needs_a_magnetometer_says_so_of_a_log_without(tmp_path: Path) -> None:
    case = attlog.prepare(SAMPLES / "px4_steps.ulg", {"mag": "none"})
    needs = tmp_path / "needs.py"
    needs.write_text(
        '"""Needs."""\nNEEDS = {"gyro", "acc", "mag"}\nSTATE = {"q": 4}\n'
        "def start(params, acc, mag, q0):\n    return q0\ndef step(state, params, dt, gyr, acc, mag):\n    pass\n"
    )
    with pytest.raises(UsageError, match="needs a magnetometer"):
        SettingsOnLog(case, parse(str(needs)), wanted(["inclination_rmse_deg"]))([{}])
