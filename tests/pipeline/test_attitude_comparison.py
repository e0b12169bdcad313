"""An attitude of one's own against a reference: closed forms, evo's formulas, and the analysis itself."""

from __future__ import annotations

import numpy as np
import pytest

import attlog
from attlog import rotation
from attlog.metrics.metric import Case
from attlog.pipeline.replay import run_rows
from tests.conftest import SAMPLES

LOG = SAMPLES / "px4_steps.ulg"
T = np.arange(0.0, 60.0, 0.02)


@pytest.fixture(scope="module")
def case() -> Case:
    return attlog.prepare(LOG, reference="truth")


def moving(t: np.ndarray) -> np.ndarray:
    return rotation.from_euler(0.4 * np.sin(t), 0.3 * np.cos(0.7 * t), 0.2 * t)


def test_a_constant_error_is_its_angle_and_has_no_relative_error() -> None:
    q = moving(T)
    turned = rotation.multiply(rotation.from_rotvec(np.radians([0.0, 0.0, 5.0])), q)
    found = attlog.compare_attitude((T, q), T, turned)
    assert found.ape["total"].rmse == pytest.approx(5.0, abs=1e-9)
    assert found.ape["heading"].max == pytest.approx(5.0, abs=1e-9)
    assert found.ape["tilt"].max == pytest.approx(0.0, abs=1e-6)
    assert found.rpe.max == pytest.approx(0.0, abs=1e-5)
    aligned = attlog.compare_attitude((T, q), T, turned, align="heading")
    assert aligned.ape["total"].max == pytest.approx(0.0, abs=1e-5)
    assert aligned.steps[0].value == pytest.approx(5.0)


def test_a_steady_drift_is_the_relative_error_over_its_interval() -> None:
    q = moving(T)
    drift = np.column_stack([np.zeros_like(T), np.zeros_like(T), np.radians(0.5) * T])
    found = attlog.compare_attitude((T, q), T, rotation.multiply(rotation.from_rotvec(drift), q), delta_s=2.0)
    assert found.rpe.mean == pytest.approx(1.0, abs=1e-6)
    assert found.rpe.n == len(T) - 100
    assert found.ape["total"].max == pytest.approx(0.5 * T[-1])


def test_statistics_are_those_of_matrices_and_traces() -> None:
    """evo's formulas for rotations: the angle of R_ref^T R, and of (R_i^T R_j)^T of both."""
    rng = np.random.default_rng(5)
    ref = moving(T)
    own = rotation.multiply(ref, rotation.from_rotvec(0.05 * rng.standard_normal((len(T), 3))))

    def angles(m: np.ndarray) -> np.ndarray:
        return np.degrees(np.arccos(np.clip((np.trace(m, axis1=1, axis2=2) - 1.0) / 2.0, -1.0, 1.0)))

    a, b = rotation.to_matrix(ref), rotation.to_matrix(own)
    absolute = angles(np.swapaxes(a, 1, 2) @ b)
    turns = [np.swapaxes(m[:-50], 1, 2) @ m[50:] for m in (a, b)]
    relative = angles(np.swapaxes(turns[0], 1, 2) @ turns[1])
    found = attlog.compare_attitude((T, ref), T, own)
    for told, errors in ((found.ape["total"], absolute), (found.rpe, relative)):
        assert told.n == len(errors)
        assert told.rmse == pytest.approx(np.sqrt(np.mean(errors**2)))
        assert (told.mean, told.median, told.std) == pytest.approx((errors.mean(), np.median(errors), errors.std()))
        assert (told.min, told.max) == pytest.approx((errors.min(), errors.max()), abs=1e-5)


def test_statistics_are_those_of_evo() -> None:
    metrics = pytest.importorskip("evo.core.metrics")
    trajectory = pytest.importorskip("evo.core.trajectory")
    rng = np.random.default_rng(6)
    ref = moving(T)
    own = rotation.multiply(ref, rotation.from_rotvec(0.05 * rng.standard_normal((len(T), 3))))
    both = [trajectory.PoseTrajectory3D(np.zeros((len(T), 3)), q, T) for q in (ref, own)]
    ape = metrics.APE(metrics.PoseRelation.rotation_angle_deg)
    rpe = metrics.RPE(metrics.PoseRelation.rotation_angle_deg, 50, metrics.Unit.frames, all_pairs=True)
    found = attlog.compare_attitude((T, ref), T, own)
    for theirs, ours in ((ape, found.ape["total"]), (rpe, found.rpe)):
        theirs.process_data(tuple(both))
        for name, value in theirs.get_all_statistics().items():
            assert name == "sse" or getattr(ours, name) == pytest.approx(value, abs=1e-5)


def test_the_faster_attitude_is_interpolated_and_no_gap_is_bridged() -> None:
    fast, slow = np.arange(0.0, 60.0, 0.004), np.arange(0.0, 60.0, 0.1)
    hole = (fast < 20.0) | (fast > 30.0)
    found = attlog.compare_attitude((slow, moving(slow)), fast[hole], moving(fast[hole]))
    assert found.ape["total"].max < 1e-3
    assert not np.any((found.t > 20.0) & (found.t < 30.0))
    assert np.isin(found.t, slow).all()


def test_a_filter_errs_by_the_same_angles_as_in_the_analysis(case: Case) -> None:
    row = attlog.evaluate(case, ["mahony"], only=["tilt_rmse_deg", "heading_rmse_deg"]).row("mahony")
    own = attlog.estimate("mahony", case)
    for window in ("all", "airborne"):
        found = attlog.compare_attitude(case, own.t, own.q, window=window)
        for angle in ("tilt", "heading"):
            assert found.ape[angle].rmse == pytest.approx(row.metrics[window][f"{angle}_rmse_deg"].value, rel=1e-6)


@pytest.mark.parametrize("name", ["mahony", "gyro", "mekf"])
def test_estimate_of_a_log_is_the_row_of_an_analysis(case: Case, name: str) -> None:
    """This truth has no trim, so a filter with a north of its own is the same to the last digit."""
    row = run_rows(case, [name])[0]
    own = attlog.estimate(name, case)
    known = rotation.heading_angle(rotation.earth_error(row.q, own.q))
    assert np.ptp(rotation.wrap(known - known[0])) < 1e-9
    assert np.max(np.abs(rotation.tilt_angle(rotation.earth_error(row.q, own.q)))) < 1e-9
    assert (row.bias is None) == (own.bias is None)
    assert own.bias is None or np.array_equal(row.bias, own.bias)


def test_attitudes_of_a_result_are_those_of_its_rows_at_common_times(case: Case) -> None:
    result = attlog.evaluate(case, ["mahony", "gyro"], traces=True)
    frame = result.attitudes()
    assert frame.index.name == "time_s"
    assert set(frame.columns.get_level_values("row")) == {"reference", "mahony", "gyro", "onboard"}
    columns = [f"q_{c}" for c in "wxyz"]
    reference = rotation.slerp(case.log.truth.t, case.log.truth.q, frame.index.to_numpy())
    error = rotation.earth_error(frame["reference"][columns].to_numpy(), reference)
    assert np.nanmax(np.degrees(rotation.total_angle(error))) < 1e-4
    own = attlog.estimate("mahony", case)
    error = rotation.earth_error(
        frame["mahony"][columns].to_numpy(), rotation.slerp(own.t, own.q, frame.index.to_numpy())
    )
    assert np.nanmax(np.degrees(rotation.total_angle(error))) < 1e-4
    angles = np.radians(frame["mahony"][["roll_deg", "pitch_deg", "yaw_deg"]].to_numpy())
    error = rotation.earth_error(rotation.from_euler(*angles.T), frame["mahony"][columns].to_numpy())
    assert np.nanmax(np.degrees(rotation.total_angle(error))) < 1e-4
    with pytest.raises(attlog.UsageError, match="no alignment of its reference; give the log"):
        attlog.compare_attitude(result, own.t, own.q)  # type: ignore[arg-type]
    with pytest.raises(attlog.UsageError, match="no row 'mahoni'; this result has reference, mahony"):
        result.attitudes(["mahoni"])
    with pytest.raises(attlog.UsageError, match="holds no attitudes"):
        attlog.evaluate(case, ["gyro"], only=["tilt_rmse_deg"]).attitudes()


@pytest.mark.parametrize(
    ("convert", "named"),
    [
        (lambda q: q[:, [1, 2, 3, 0]], "scalar last"),
        (rotation.conjugate, "earth to body"),
        (lambda q: rotation.multiply(rotation.multiply(rotation.ENU, q), rotation.FLU), "ENU and FLU"),
    ],
)
def test_another_convention_of_quaternions_is_named(convert, named: str) -> None:
    q = moving(T)
    with pytest.warns(attlog.UnitWarning, match=named):
        attlog.compare_attitude((T, q), T, convert(q))


def test_times_on_another_clock_are_refused_with_the_one_that_fits(case: Case) -> None:
    q = moving(T)
    boot = case.log.t0_us + 1e6 * T
    with pytest.raises(attlog.UsageError, match=r"no time in .*; t \* 1e-06"):
        attlog.compare_attitude(case, boot, q)
    with pytest.raises(attlog.UsageError, match="no time in"):
        attlog.compare_attitude((T, q), T + 1e4, q)
    with pytest.warns(attlog.UnitWarning, match=r"like ms; give t \* 0.001"):
        attlog.compare_attitude((T, q), 1e3 * T, moving(1e3 * T))


@pytest.mark.parametrize(
    ("call", "why"),
    [
        (lambda q: attlog.compare_attitude((T, q), T, q[:, :3]), "from_euler"),
        (lambda q: attlog.compare_attitude((T, q), T[:5], q), r"q \(n, 4\)"),
        (lambda q: attlog.compare_attitude((T, q), T, q, window="hover"), "give the log"),
        (lambda q: attlog.compare_attitude((T, q), T, q, align="all"), "auto, none or heading"),
        (lambda q: attlog.compare_attitude((T, q), T, q, delta_s=0.0), "delta_s"),
        (lambda q: attlog.compare_attitude((T, q), T, q, delta_s="a"), "delta_s='a'"),  # type: ignore[arg-type]
        (lambda q: attlog.compare_attitude((T, q), T, q, window=None), "window=None: give"),  # type: ignore[arg-type]
        (lambda q: attlog.compare_attitude((T, q), T, q, window=5), "window=5: give"),  # type: ignore[arg-type]
        (lambda q: attlog.compare_attitude(7, T, q), "not int"),  # type: ignore[arg-type]
        (lambda q: attlog.compare_attitude((T, q), T, np.nan * q), "0 usable attitudes"),
    ],
)
def test_what_cannot_be_compared_is_an_error_with_its_reason(call, why: str) -> None:
    with pytest.raises(attlog.UsageError, match=why):
        call(moving(T))


def test_a_log_brings_its_own_samples_and_no_others(case: Case) -> None:
    with pytest.raises(attlog.UsageError, match="acc: a log brings its own"):
        attlog.estimate("mahony", case, acc=np.zeros((3, 3)))
    with pytest.raises(attlog.UsageError, match="needs a log or gyro samples"):
        attlog.estimate("mahony", T)
    with pytest.raises(attlog.UsageError, match=r"attlog.prepare\(log\), not FlightLog"):
        attlog.evaluate(case.log, ["mahony"])  # type: ignore[arg-type]
