"""An estimate that never ran, began late or froze is no attitude while it stands, and a sound one loses nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog.core import rotation
from attlog.flight import frozen
from attlog.flight.model import Attitude, Firmware, FlightLog, Imu, Stream
from tests.conftest import corpus_logs

T = np.arange(0.0, 40.0, 0.02)
RNG = np.random.default_rng(1)


def turning(t: np.ndarray) -> np.ndarray:
    """Headings of a vehicle that turns at 20 deg/s from 10 to 20 s, rad."""
    return np.asarray(0.3 + np.radians(20.0) * np.clip(t - 10.0, 0.0, 10.0))


def attitude(heading: np.ndarray, **more: object) -> Attitude:
    angles = np.round(np.degrees(heading), 2)
    q = rotation.from_euler(np.full(len(T), np.radians(0.61)), np.full(len(T), np.radians(0.75)), np.radians(angles))
    return Attitude(T, q, "EKF", **more)  # type: ignore[arg-type]


def flight(**attitudes: Attitude) -> FlightLog:
    rate = np.zeros((len(T), 3))
    rate[:, 2] = np.gradient(turning(T), T)
    measured = rate + 1e-3 * RNG.standard_normal(rate.shape) + np.array([0.1, 0.0, 0.0])
    gyro = Stream(T, measured, "rad/s", "FRD", "IMU")
    acc = Stream(T, np.tile([0.0, 0.0, -9.81], (len(T), 1)), "m/s^2", "FRD", "IMU")
    log = FlightLog(Path("made"), "made", 0, 0, Firmware("made"), "rover", imus=[Imu(0, gyro, acc, "IMU")], imu=0)
    log.attitudes, log.onboard = dict(attitudes), "ATT"
    frozen.drop_stuck_attitudes(log)
    return log


def said(log: FlightLog) -> list[tuple[str, str]]:
    return [(p.severity, p.text) for p in log.problems if p.code == frozen.STUCK_CODE]


def test_one_that_never_ran_is_not_used_and_the_sound_one_keeps_every_record() -> None:
    log = flight(ATT=attitude(turning(T)), EKF1=attitude(0.0 * T))
    assert list(log.attitudes) == ["ATT"]
    assert len(log.attitudes["ATT"].t) == len(T)
    assert said(log) == [
        ("note", "EKF1: all 2,000 records hold one attitude, so this estimate never ran; it is not used.")
    ]


def test_where_it_is_the_one_that_flew_it_is_a_warning_and_nothing_flew() -> None:
    log = flight(ATT=attitude(np.full(len(T), 0.8)))
    assert log.onboard is None
    assert [weight for weight, _ in said(log)] == ["warning"]


def test_a_heading_never_set_before_it_began_is_left_out_and_resets_keep_their_records() -> None:
    """It stands for 8 s in which nothing turns: only its heading of exactly 0 tells."""
    begun = np.where(T < 8.0, 0.0, turning(T))
    log = flight(ATT=attitude(turning(T)), EKF1=attitude(begun, resets=np.array([400, 1000]), t_sample=T - 0.001))
    kept = log.attitudes["EKF1"]
    assert kept.t[0] == pytest.approx(8.0)
    assert kept.t[kept.resets].tolist() == pytest.approx([8.0, 20.0])
    assert kept.t_sample is not None
    assert np.allclose(kept.t - kept.t_sample, 0.001)
    assert said(log) == [
        ("note", "EKF1: it holds one attitude to 8.0 s, before this estimate ran; 400 records are left out.")
    ]


def test_one_that_stands_while_the_gyro_turns_froze_and_one_that_stands_at_rest_did_not() -> None:
    wobble = 1e-3 * RNG.standard_normal(len(T))
    stuck = turning(T) + wobble
    stuck[(T > 12.0) & (T < 16.0)] = stuck[600]
    log = flight(ATT=attitude(stuck))
    assert log.onboard == "ATT"
    assert not ((log.attitudes["ATT"].t > 12.1) & (log.attitudes["ATT"].t < 15.9)).any()
    ((weight, text),) = said(log)
    assert weight == "warning"
    assert text.startswith("ATT: the attitude froze for 4.0 s from 12.0 s;")
    assert said(flight(ATT=attitude(turning(T)))) == []  # stands to 10 s and from 20 s on, as a rounded one does


def test_a_made_vehicle_whose_gyro_never_moves_may_have_one_attitude() -> None:
    log = flight(ATT=attitude(turning(T)))
    for imu in log.imus:
        imu.gyro.x[:] = 0.0
    log.attitudes["EKF1"] = attitude(0.0 * T)
    frozen.drop_stuck_attitudes(log)
    assert list(log.attitudes) == ["ATT", "EKF1"]


@pytest.mark.parametrize(
    ("name", "gone"),
    [("bin_rover_2.46beta2.BIN", "EKF1"), ("cases/rover_2.46_61.BIN", "EKF1"), ("tlog_mav1_plane_3.8.5.tlog", "AHRS3")],
)
def test_real_logs_name_the_estimates_that_never_ran(corpus: Path, name: str, gone: str) -> None:
    log = attlog.read(corpus / "logs" / name)
    assert gone not in log.attitudes
    assert any(p.code == frozen.STUCK_CODE and p.text.startswith(f"{gone}: all") for p in log.problems)


@pytest.mark.parametrize("path", corpus_logs(".ulg", ".bin", ".tlog"), ids=lambda p: p.name)
def test_no_attitude_that_moves_all_along_loses_a_record(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    try:
        after = attlog.read(path)
        monkeypatch.setattr(attlog.flight, "drop_stuck_attitudes", lambda log: None)
        before = attlog.read(path)
    except attlog.AttlogError as error:
        pytest.skip(str(error))
    for name, whole in before.attitudes.items():
        left = len(whole.t) - (len(after.attitudes[name].t) if name in after.attitudes else 0)
        moves = (whole.q[1:] != whole.q[:-1]).any(axis=1)
        assert left == 0 or (~moves).sum() >= left - 1
        assert name != before.onboard or left == 0
