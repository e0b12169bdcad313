"""One log, two halves: what is prepared once serves any number of evaluations."""

from __future__ import annotations

import logging
import subprocess
import sys
import weakref
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import attlog
from attlog import estimators, metrics
from attlog.core.errors import RAISE_VARIABLE, AttlogError, PluginError, PluginTimeout, UsageError
from attlog.estimators.interface import Estimate
from attlog.metrics.metric import Case
from attlog.pipeline import evaluation, preparation, replay
from attlog.pipeline.evaluation import problems_of_reference_and_filters
from attlog.pipeline.preparation import Stages
from attlog.reference.model import Track
from attlog.result import Answer, EstimatorRow, Result

LOG = Path(__file__).parents[2] / "sample_logs" / "copter_steps_stabilize.bin"


@pytest.fixture(scope="module")
def case() -> Case:
    return attlog.prepare(LOG)


@pytest.fixture(scope="module")
def alone(case: Case) -> Result:
    """One filter, evaluated once for all tests that only look."""
    return attlog.evaluate(case, "mahony")


@pytest.fixture(scope="module")
def pair(case: Case) -> Result:
    return attlog.evaluate(case, "mahony,madgwick")


def answers(result: Result, name: str) -> dict[str, dict[str, Answer]]:
    return next(row.metrics for row in result.estimators if row.name == name)


def test_a_second_evaluation_prepares_nothing_again(case: Case, alone: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    first = alone

    def again(*_: object, **__: object) -> None:
        raise AssertionError("prepared again")

    for module, names in (
        (evaluation, ("describe",)),
        (preparation.flight, ("read",)),
        (preparation.segments, ("build",)),
        (evaluation.reference, ("choose", "heading_references", "onboard_rows")),
    ):
        for name in names:
            monkeypatch.setattr(module, name, again)
    second = attlog.evaluate(case, ["madgwick"])
    assert [r.name for r in first.estimators][:2] == ["mahony", "onboard"]
    assert [r.name for r in second.estimators][:2] == ["madgwick", "onboard"]
    assert answers(first, "onboard") == answers(second, "onboard")
    assert (first.log, first.checks, first.reference) == (second.log, second.checks, second.reference)


def test_a_filter_gets_the_same_answers_alone_as_among_others(case: Case, alone: Result) -> None:
    """But for what compares it with the others: ranking of headings, costs."""
    among = answers(attlog.evaluate(case, "madgwick,mahony,ekf12"), "mahony")
    values = {(w, m): (a.value, a.ci95) for w, found in answers(alone, "mahony").items() for m, a in found.items()}
    assert values == {(w, m): (a.value, a.ci95) for w, found in among.items() for m, a in found.items()}
    assert sum(v is not None for v, _ in values.values()) > 10


@pytest.mark.slow
def test_two_evaluations_of_one_name_with_other_parameters_do_not_mix(case: Case, tmp_path: Path) -> None:
    """Nothing is remembered by a row's name: a tuned file keeps its name and changes its filter."""
    file = tmp_path / "mine.py"
    noise = []
    for gain in ("0.0", "5.0"):
        file.write_text(
            '"""Gyro with a pull towards one axis."""\nimport numpy as np\n'
            "def start(params, acc, mag, q0):\n    return q0\n"
            "def step(state, params, dt, gyr, acc, mag):\n"
            "    x, y, z = 0.5 * dt * gyr\n    a, b, c, d = state[0:4]\n"
            f"    x += 0.001 * {gain} * acc[0]\n"
            "    state[0] -= b * x + c * y + d * z\n    state[1] += a * x + c * z - d * y\n"
            "    state[2] += a * y - b * z + d * x\n    state[3] += a * z + b * y - c * x\n"
        )
        result = attlog.evaluate(case, [str(file)])
        noise.append(answers(result, result.estimators[0].name)["all"]["total_rmse_deg"].value)
    assert None not in noise
    assert noise[0] != noise[1]


def test_results_of_one_case_share_no_answers_and_no_lists(case: Case) -> None:
    first, second = (attlog.evaluate(case, "gyro") for _ in range(2))
    flown = next(row.name for row in second.estimators if row.kind == "onboard")
    kept = {name: (a.value, a.each[:], len(a.records)) for name, a in answers(second, flown)["all"].items()}
    for answer in answers(first, flown)["all"].values():
        answer.value = 999.0
        answer.each.clear()
        answer.records.clear()
    first.checks.clear()
    first.events.clear()
    assert kept == {name: (a.value, a.each, len(a.records)) for name, a in answers(second, flown)["all"].items()}
    third = attlog.evaluate(case, "gyro")
    assert kept == {name: (a.value, a.each, len(a.records)) for name, a in answers(third, flown)["all"].items()}
    assert second.checks == third.checks != []
    assert second.events == third.events != []


def test_nothing_went_wrong_is_not_said_beside_a_metric_that_failed(
    case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> Any:
        raise ZeroDivisionError

    sound = "Nothing went wrong" in attlog.evaluate(case, "gyro").headline
    groups = [group._replace(compute=fails) if group.name == "set-point" else group for group in metrics.groups()]
    monkeypatch.setattr(metrics, "groups", lambda: groups)
    monkeypatch.delenv(RAISE_VARIABLE, raising=False)
    result = attlog.evaluate(case, "gyro")
    assert [finding.kind for finding in result.findings].count("part_failed")
    assert (sound, "Nothing went wrong" in result.headline) == (True, False)


def test_traces_and_costs_come_when_asked_for(case: Case, alone: Result) -> None:
    full = attlog.evaluate(case, "mahony", traces=True, cost=True)
    assert (alone.traces, "cost_ns" in answers(alone, "mahony")["all"]) == ([], False)
    assert {"attitude", "difference"} <= {t.figure for t in full.traces}
    assert "cost_ns" in answers(full, "mahony")["all"]


@pytest.mark.slow
def test_nothing_of_a_row_is_left_when_the_next_one_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of fifty configurations of a long log one is held at a time; what the onboard rows have is kept."""
    case = attlog.prepare(LOG)  # its own: what is kept for a log must not hold a row either
    replays, arrays, alive = replay.replays, dict[str, list[Any]](), list[list[str]]()

    def passing(*given: Any, **more: Any) -> Any:
        for row, line in replays(*given, **more):
            alive.append([name for name, refs in arrays.items() if any(ref() is not None for ref in refs)])
            assert row is not None
            assert row.errors is not None
            found = [row.q, row.bias, row.errors.total, row.errors.q_est]
            arrays[row.name] = [weakref.ref(x) for x in found if x is not None]
            del found
            yield row, line

    monkeypatch.setattr(replay, "replays", passing)
    result = attlog.evaluate(case, "madgwick,mahony,gyro,ekf12", traces=True)
    assert list(arrays) == ["madgwick", "mahony", "gyro", "ekf12"]
    assert alive == [[], [], [], []]
    assert {*arrays, "onboard"} <= {t.row for t in result.traces if t.figure == "difference"}
    assert answers(result, "onboard") == answers(attlog.evaluate(case, "gyro"), "onboard")


def test_the_arrays_of_a_run_that_failed_are_released(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its error is kept with its type and text, but without the frames of the run, even those of its cause."""
    arrays: list[weakref.ref[Any]] = []

    def failing(*_: object, **__: object) -> None:
        inputs = np.zeros(10)
        arrays.append(weakref.ref(inputs))
        try:
            inputs[[]].max()
        except ValueError as error:
            raise PluginTimeout("too slow") from error

    monkeypatch.setattr(replay, "_run", failing)
    failed: dict[str, AttlogError] = {}
    lines = [line.status for _, line in replay.replays(case, replay.select_rows(["mahony"], case.log), failed)]
    assert (lines, type(failed["mahony"]), str(failed["mahony"])) == (["failed"], PluginTimeout, "too slow")
    assert [array() for array in arrays] == [None]


def test_a_row_that_has_passed_is_run_again_where_another_is_equal(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    again, asked = replay.run_again, list[str]()

    def asking(case: Case, chosen: Any, name: str) -> Track:
        asked.append(name)
        return again(case, chosen, name)

    monkeypatch.setattr(replay, "run_again", asking)
    result = attlog.evaluate(case, "mahony,gyro,mahony:kp=0.45", traces=True)
    assert asked == ["mahony"]
    (group,) = result.alike
    assert group.rows == ["mahony", "mahony:kp=0.45"]
    assert group.apart_deg is not None
    assert group.apart_deg < 1e-9


def test_only_what_is_wanted_is_measured_and_has_the_same_answers(case: Case, pair: Result) -> None:
    whole = pair
    some = attlog.evaluate(case, "mahony,madgwick", only={"lag_ms", "drift_air_deg_per_min"})
    assert (some.verdicts, some.findings) == ([], [])
    for name in ("mahony", "madgwick", "onboard"):
        every, wanted = answers(whole, name), answers(some, name)
        assert {m for found in wanted.values() for m in found} >= {"lag_ms", "drift_air_deg_per_min.onboard"}
        assert not {m for found in wanted.values() for m in found if m.startswith(("noise_", "tilt_"))}
        assert all(every[w][m] == a for w, found in wanted.items() for m, a in found.items())
    assert {m: some.best["airborne"][m] for m in some.best["airborne"]}.items() <= whole.best["airborne"].items()


def test_analyze_is_both_halves(alone: Result) -> None:
    whole, halves = attlog.analyze(LOG, {"estimators": "mahony"}), alone
    assert whole.traces
    assert "cost_ns" in answers(whole, "mahony")["all"]
    for window, found in answers(halves, "mahony").items():
        assert {m: a.value for m, a in found.items()} == {
            m: a.value for m, a in answers(whole, "mahony")[window].items() if not m.startswith("cost")
        }
    assert whole.config == halves.config
    assert list(whole.timing) == ["read", "segments", "reference", "checks", "estimators", "metrics", "signals"]


class Heard(logging.Handler):
    """Keeps stages and what is known of the result, in the order in which they are logged."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.messages: list[Any] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.messages.append(record.__dict__.get("result", record.msg))


@pytest.fixture
def heard() -> Iterator[Heard]:
    handler = Heard()
    loggers = [logging.getLogger(name) for name in ("attlog.known", "attlog.stages")]
    for logger in loggers:
        logger.addHandler(handler)
        logger.setLevel(logging.INFO)
    yield handler
    for logger in loggers:
        logger.removeHandler(handler)
        logger.setLevel(logging.NOTSET)


def test_title_and_headline_are_known_before_the_filters_run(heard: Heard) -> None:
    result = attlog.analyze(LOG, estimators=["mahony"])
    known = [message for message in heard.messages if isinstance(message, Result)]
    assert [one.headline for one in known] == ["", result.headline]
    assert all(
        one.log[key] == result.log[key] for one in known for key in ("name", "vehicle", "firmware", "duration_s")
    )
    assert (known[1].checks, known[1].events) == (result.checks, result.events)
    assert heard.messages.index(known[1]) < heard.messages.index("running filters")


def test_the_headline_waits_for_filters_that_refuse_the_onboard_attitude(corpus: Path, heard: Heard) -> None:
    result = attlog.analyze(corpus / "logs" / "bin_plane_3.0.4beta3_nomag.BIN")
    assert result.reference is not None
    assert "onboard" in result.reference.refused
    assert [one.headline for one in heard.messages if isinstance(one, Result)] == [""]


def test_the_headline_does_not_wait_where_the_mean_force_agrees_with_the_reference(corpus: Path, heard: Heard) -> None:
    result = attlog.analyze(corpus / "logs" / "cases" / "copter_4.5.7_gps_delay.BIN", estimators=["gyro"])
    assert result.reference is not None
    assert result.reference.choice == "smoother"
    assert [one.headline for one in heard.messages if isinstance(one, Result)] == ["", result.headline]


@pytest.mark.parametrize("name", ["log_tradheli_brownout.log", "cases/copter_4.2_radio_4hz.tlog"])
def test_a_log_that_cannot_be_replayed_has_the_height_of_its_headline(corpus: Path, name: str) -> None:
    result = attlog.analyze(corpus / "logs" / name)
    (height,) = [trace for trace in result.traces if trace.figure == "height"]
    assert f"up to {height.values['top']:.0f} m" in result.headline
    flown = [(a, b) for a, b in result.log["timeline"]["airborne"]]
    inside = np.any([(height.t >= a) & (height.t <= b) for a, b in flown], axis=0)
    assert np.nanmax(height.columns["height"][inside]) == pytest.approx(height.values["top"], rel=0.1)


def test_the_result_tells_which_time_is_scored(case: Case, alone: Result) -> None:
    def scored(result: Result) -> tuple[float, float | None]:
        assert result.reference is not None
        return result.reference.scoring_start_s, result.reference.scoring_end_s

    seconds = case.log.seconds
    assert scored(alone)[0] == pytest.approx(15.0 if seconds >= 30.0 else seconds / 3.0, abs=0.1)
    assert scored(attlog.evaluate(attlog.prepare(LOG, {"score_from": 3.5}), "gyro")) == (3.5, None)


def test_a_configuration_may_be_a_mapping() -> None:
    settings = {"reference": "none", "window": "1:5", "imu": "all"}
    prepared = attlog.prepare(LOG, settings)
    assert prepared.reference.kind == "none"
    assert "1:5" in prepared.windows
    assert list(prepared.imus) == [f"/imu{imu.index}" for imu in prepared.log.imus]
    assert prepared.settings == attlog.prepare(LOG, attlog.Config.build(settings)).settings
    with pytest.raises(UsageError, match="did you mean window"):
        attlog.analyze(LOG, {"windows": "1:5"})


def test_without_a_reference_all_evaluations_have_the_same_heading_references() -> None:
    """The magnetometer has to be levelled by something: not by whichever filter comes first."""
    prepared = attlog.prepare(LOG, {"reference": "none"})
    heading = prepared.heading_references["mag"]
    onboard = prepared.heading_references["onboard"]
    flown = np.interp(heading.t, onboard.t, np.degrees(np.unwrap(np.radians(onboard.heading_deg))))
    off = (heading.heading_deg - flown + 180.0) % 360.0 - 180.0
    assert np.median(np.abs(off - np.median(off))) < 3.0
    attlog.evaluate(prepared, ["gyro"])
    assert prepared.heading_references["mag"] is heading


@pytest.mark.parametrize("settings", [{"imu": 7}, {"mag": "none"}, {"boot": 3}, {"params": "x.param"}])
def test_a_log_that_was_read_cannot_be_read_otherwise(settings: dict[str, object]) -> None:
    log = attlog.read(LOG)
    with pytest.raises(UsageError, match="chosen when the log is read"):
        attlog.prepare(log, settings)
    assert log.imu is not None
    assert attlog.prepare(log, {"imu": log.imus[log.imu].index}).log is log


TURNED = '''"""A filter whose heading is off by 92 deg."""

import numpy as np

from attlog.core import rotation
from attlog.estimators import estimate, Estimate

NEEDS, USES = {"gyro", "acc"}, {"mag"}


def run(t, gyr, acc, mag, aids, params):
    right = estimate("mahony", t, gyr, acc, mag)
    return Estimate(t=right.t, q=rotation.turn_about_down(right.q, np.radians(92.0)))
'''


def test_a_row_92_deg_off_in_heading_is_never_best(samples, tmp_path):
    """Its tilt is that of mahony to the last bit, and mahony beats madgwick in tilt in this log."""
    (tmp_path / "turned.py").write_text(TURNED)
    case = attlog.prepare(samples / "copter_yaw_turns.bin")
    result = attlog.evaluate(case, f"complementary@fan,madgwick:beta=1,{tmp_path / 'turned.py'}")
    rows = {row.name: row for row in result.estimators}
    assert rows["turned"].status == "diverged"
    assert "heading" in rows["turned"].reason
    assert rows["complementary@fan"].status == "ok"
    marked = {name for metrics in result.best.values() for names in metrics.values() for name in names}
    assert marked
    assert "turned" not in marked
    assert rows["turned"].metrics["all"]["heading_rmse_deg"].value == pytest.approx(92.0, abs=5.0)


def smoothed(log: object, phases: object, options: object, *, compass: bool = True) -> Estimate:
    """What a smoother would find: the truth, with its sigmas."""
    truth = attlog.read(LOG).truth
    assert truth is not None
    aux = {name: np.full(len(truth.t), 1e-3) for name in ("sigma_tilt", "sigma_heading")}
    return Estimate(truth.t, truth.q, aux=aux, quality={"aided_by": "gnss"})


def test_with_the_smoother_as_reference_the_onboard_attitude_is_a_row(
    pair: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(replay, "smoother", smoothed)
    result = attlog.evaluate(attlog.prepare(LOG, {"reference": "smoother"}), "mahony,madgwick", traces=True)
    assert result.reference is not None
    assert (result.reference.choice, result.reference.sigma_tilt_deg) == ("smoother", pytest.approx(0.0573, abs=1e-4))
    for name in ("onboard", "mahony"):
        for metric in ("tilt_rmse_deg", "lag_ms", "drift_air_deg_per_min.smoother"):
            found = answers(result, name)["airborne"][metric]
            expected = answers(pair, name)["airborne"][metric.replace("smoother", "truth")]
            assert found.value == pytest.approx(expected.value, abs=0.02), (name, metric)
    assert {"attitude", "sigma"} <= {t.figure for t in result.traces if t.row == "smoother"}
    assert "sigma 0.057" in " ".join(result.verdicts[0].notes)
    assert "smoother" in result.timing


def test_a_stage_within_another_counts_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock that is read as each begins and ends: reference from 0 to 61 s, two smoothers in it."""
    ticks = iter([0.0, 10.0, 40.0, 41.0, 60.0, 61.0])
    monkeypatch.setattr(preparation, "time", SimpleNamespace(perf_counter=lambda: next(ticks)))
    clock = Stages({"smoother": 1.0})
    with clock("reference"):
        for _ in range(2):
            with clock("smoother"):
                pass
    assert clock.seconds == {"smoother": 1.0 + 30.0 + 19.0, "reference": 61.0 - 49.0}


def test_what_computed_the_numbers_is_told_without_another_process() -> None:
    """``platform.processor`` runs ``uname -p``: a copy of the process with all its memory, for nothing."""
    code = (
        "import sys; from attlog.core.machine import versions\n"
        "sys.addaudithook(lambda event, _: event == 'subprocess.Popen' and sys.exit('a process was started'))\n"
        "print(versions()['cpu'])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.strip()


# What an analysis says of filters that did not run.

SOUND: Any = SimpleNamespace(kind="onboard", gave_way=[], contradiction="", rejected=[])


@pytest.mark.parametrize(
    ("error", "code", "severity"),
    [
        (UsageError("gsf needs gnss, which was not given"), "estimator_failed", "note"),
        (PluginError("line 3: ZeroDivisionError"), "estimator_failed", "error"),
        (PluginTimeout("took longer than 60 s"), "estimator_timed_out", "error"),
        (None, "estimator_failed", "error"),
    ],
)
def test_a_log_that_is_not_enough_for_a_filter_is_no_trouble(
    error: AttlogError | None, code: str, severity: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("attlog.pipeline.evaluation.contradiction", lambda ref: [])
    row = EstimatorRow("mine", "replay", "mine", "failed", str(error))
    found = problems_of_reference_and_filters(SOUND, [row], {} if error is None else {"mine": error}, {}, [])
    assert [(p.code, p.severity) for p in found] == [(code, severity)]


def test_an_unknown_metric_is_an_error_that_names_the_nearest(case: Case) -> None:
    with pytest.raises(UsageError, match="no metric 'tilt_rms_deg'; did you mean tilt_rmse_deg"):
        attlog.evaluate(case, "gyro", only="tilt_rms_deg")


def test_a_row_given_as_an_object_is_kept_by_its_name(case: Case) -> None:
    result = attlog.evaluate(case, [estimators.parse("mahony:kp=0.3")], only="lag_ms")
    assert result.config["estimators"] == ["mahony:kp=0.3"]
