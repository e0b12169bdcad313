"""Made flights with a truth, an onboard attitude and estimates whose errors are known."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog import segments
from attlog.core import rotation
from attlog.estimators.interface import Estimate
from attlog.flight import parameters
from attlog.flight.ardupilot import reader
from attlog.flight.imu import low_pass_delay
from attlog.flight.model import Attitude, Firmware, FlightLog, TimeLine
from attlog.flight.px4.reader import DECLINATION_PARAMETERS
from attlog.reference import Reference, ReferenceCheck, ReferenceOptions, Track, choose, replayed
from attlog.reference.model import Alignment, Faults, HeadingOrigin, ReferenceSigma, Scoring
from attlog.segments import Segments
from tests.segments.flights import imu_log

Array = NDArray[np.float64]

SECONDS, RATE = 60.0, 100.0


def attitude_at(t: Array) -> Array:
    """The true attitude: still for 20 s, then gently set into turning through south again and again."""
    late = np.maximum(t - 20.0, 0.0)
    moving = late - 1.0 + np.exp(-late)
    swing = np.radians(15) * np.sin(0.9 * moving)
    return rotation.from_euler(swing, 0.6 * np.radians(15) * np.sin(0.7 * moving), 3.0 + 0.4 * moving)


def body_rate(t: Array) -> Array:
    """The gyro of the true attitude, rad/s."""
    h = 1e-4
    turn = rotation.multiply(rotation.conjugate(attitude_at(t - h)), attitude_at(t + h))
    return rotation.to_rotvec(turn) / (2 * h)


def flight(
    seconds: float = SECONDS,
    onboard_hz: float = 20.0,
    truth_hz: float | None = None,
    seed: int = 1,
    gyro_late: float = 0.0,
) -> FlightLog:
    """A log whose onboard attitude is exact, with truth where a rate is given."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1 / RATE)
    still = t < 20.0
    gyro = body_rate(t - gyro_late) + np.radians(0.05) * rng.normal(size=(len(t), 3))
    acc = rotation.rotate_inverse(attitude_at(t), np.array([0.0, 0.0, -9.81]))
    acc += np.where(still, 0.02, 0.5)[:, None] * rng.normal(size=acc.shape)
    log = imu_log(t, gyro, acc)
    log.attitudes = {"ATT": sampled(onboard_hz, seconds)}
    log.onboard = "ATT"
    if truth_hz is not None:
        log.truth = sampled(truth_hz, seconds, "SIM")
    return log


def sampled(rate: float, seconds: float = SECONDS, source: str = "ATT", **more) -> Attitude:
    """The true attitude at a rate."""
    t = np.arange(0.0, seconds, 1 / rate)
    return Attitude(t, attitude_at(t), source, **more)


def ardupilot(log: FlightLog, **params: float) -> FlightLog:
    """The same log from ArduPilot with parameters."""
    log.firmware = Firmware("ArduPilot", "4.6.0")
    log.parameters.lines = {name: TimeLine(np.zeros(1), [value], "PARM") for name, value in params.items()}
    log.parameters.trim, log.parameters.trim_source = reader.read_trim(log), ", ".join(reader.TRIM_PARAMETERS)
    names = reader.DECLINATION_PARAMETERS | DECLINATION_PARAMETERS
    no_messages = SimpleNamespace(params=[])
    parameters.add_values(SimpleNamespace(log=log, messages=no_messages), names)
    if "INS_GYRO_FILTER" in params:
        log.imus[0].gyro.delay = low_pass_delay(params["INS_GYRO_FILTER"])
        log.imus[0].filtered = f"low-pass {params['INS_GYRO_FILTER']:.0f} Hz"
    return log


def estimate(t: Array | None = None, heading_deg: float | Array = 0.0, tilt_deg: float | Array = 0.0) -> Estimate:
    """An estimate at the IMU's times with a known heading error and a tilt error about north."""
    t = np.arange(0.0, SECONDS, 1 / RATE) if t is None else t
    q = rotation.turn_about_down(attitude_at(t), np.radians(heading_deg) + 0 * t)
    north = np.radians(np.broadcast_to(tilt_deg, t.shape))[:, None] * [1.0, 0.0, 0.0]
    return Estimate(t, rotation.multiply(rotation.from_rotvec(north), q))


def compared(
    log: FlightLog, e: Estimate, options: ReferenceOptions | None = None, **more
) -> tuple[Track, Reference, Segments]:
    """The row of an estimate, with what it was compared to. It uses a magnetometer unless said."""
    found = segments.build(log)
    reference = choose(log, found, options or ReferenceOptions(declination=0.0))
    return replayed(log, found, reference, e, name="made", **{"uses_mag": True, **more}), reference, found


def grouped(**flat: Any) -> dict[str, Any]:
    """Return fields of a reference in their groups: ``scoring_start=15.0`` becomes ``scoring=Scoring(start=15.0)``."""
    of: dict[str, dict[str, str]] = {
        "scoring": {"scoring_start": "start", "end": "end", "unscored": "unscored", "refuted": "refuted"},
        "heading": {"heading_by": "by", "heading_why": "why"},
        "faults": {"fault": "reference", "gyro_fault": "gyro", "refused": "refused", "sensor_faults": "sensors"},
        "alignment": {n: n for n in ("clock", "trim", "declination_deg", "input_delay_s", "floor_deg", "step_deg")},
        "sigma": {"sigma_tilt_deg": "tilt_deg", "sigma_heading_deg": "heading_deg"},
    }
    kinds = {
        "scoring": Scoring,
        "heading": HeadingOrigin,
        "faults": Faults,
        "alignment": Alignment,
        "sigma": ReferenceSigma,
    }
    found: dict[str, Any] = {name: kinds[name]() for name in ("scoring", "heading", "faults", "alignment")}
    for group, names in of.items():
        mine = {new: flat.pop(old) for old, new in names.items() if old in flat}
        if mine:
            found[group] = kinds[group](**mine)
    return found | flat


def contradicted(log: FlightLog, imu: Any, reference: Reference, rows: list[Track]) -> Any:
    """Return the verdict of a check over rows that are all at hand."""
    check = ReferenceCheck(log, imu, reference, lambda row: row)
    for row in rows:
        check.add(row)
    return check.contradicted()
