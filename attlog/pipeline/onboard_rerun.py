"""Run the onboard filter again, and measure its deviation from the flown attitude."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog import estimators, reference
from attlog.core import rotation
from attlog.core.earth import GAUSS_PER_TESLA
from attlog.core.errors import UsageError
from attlog.core.limits import RELEASED_BYTES
from attlog.core.sorting import median, nanmedian, quantile
from attlog.estimators.ekf2.parameters import TABLE as EKF2
from attlog.estimators.ekf3.parameters import TABLE as EKF3
from attlog.estimators.interface import Estimate
from attlog.estimators.registry import FLOWN
from attlog.estimators.rerun import Mode, Rerun, logged_tables
from attlog.flight.model import FlightLog, Imu, Mag
from attlog.metrics.metric import Case, per_case
from attlog.metrics.rerun import DIFFERENCE, rerun_traces
from attlog.metrics.trace import Trace
from attlog.reference import alignment
from attlog.reference.model import Reproduction, Track
from attlog.result import EstimatorRow

Array = NDArray[np.float64]

# Largest differences (deg) between a re-run and the flown airborne attitude. Beyond them no parameter is studied.
MAX_TILT_MEDIAN_DEG, MAX_TILT_P95_DEG, MAX_HEADING_MEDIAN_DEG = 0.5, 1.5, 2.0
# Below this airborne time the whole log is compared.
MIN_AIRBORNE_S = 5.0
# Fewest records of the onboard attitude for a comparison.
MIN_RECORDS = 20


# Estimator that re-runs the filter of each firmware.
BY_FIRMWARE = {"PX4": "px4_ekf2", "ArduPilot": "ap_ekf3"}
OLDEST_EKF2 = (1, 8)
# AHRS_EKF_TYPE of EKF3.
EKF3_TYPE = 3


def flown_filter(log: FlightLog) -> str:
    """Return the estimator that re-runs the flown filter; empty if there is none.

    PX4 1.7 and older flew other filters by default; ArduPilot flew EKF3 where AHRS_EKF_TYPE is 3.
    """
    name = BY_FIRMWARE.get(log.firmware.name, "")
    version = re.match(r"(\d+)\.(\d+)", log.firmware.version or "")
    if name == "px4_ekf2" and version and (int(version[1]), int(version[2])) < OLDEST_EKF2:
        return ""
    if name == "ap_ekf3" and log.param("AHRS_EKF_TYPE") != EKF3_TYPE:
        return ""
    return name if name in FLOWN and log.estimator.inputs is not None else ""


@per_case
def inputs_of(case: Case, unit: str) -> Any:
    """Read the inputs of the onboard filter. UsageError without them.

    A log with several filter cores gives those of the core on the IMU ``unit``.
    """
    read = case.log.estimator.inputs
    if read is None:
        raise UsageError("An onboard filter is run again only on a log of PX4 that EKF2 flew, or ArduPilot and EKF3.")
    try:
        return read(unit=int(unit)) if unit else read()
    finally:
        if case.log.messages is not None and case.log.messages.size > RELEASED_BYTES:  # the inputs are copies
            case.log.messages.forget()


def flown_inputs(case: Case, imu: Imu) -> Any:
    """Return the inputs of the filter that flew on an IMU."""
    return inputs_of(case, str(imu.index) if case.log.firmware.name == "ArduPilot" else "")


def check_changes(name: str, changes: Iterable[str], version: tuple[int, int]) -> None:
    """UsageError for parameters (full names) of a flown filter that a firmware version does not have."""
    table = EKF2 if name == "px4_ekf2" else EKF3
    table.check([table.short(n) for n in changes], version)


def start_parameters(name: str) -> set[str]:
    """Return the full names of a flown filter's parameters that act on a cold start alone."""
    table = EKF2 if name == "px4_ekf2" else EKF3
    return {table.full(short) for short in table.at_start}


@per_case
def gnss_rate_of(case: Case, _: str) -> float | None:
    """Fit the onboard rate of the GNSS receiver, with the flown parameters."""
    from attlog.estimators.ekf2.run import fitted_gnss_rate

    return fitted_gnss_rate(inputs_of(case, ""), *_field(case.log))


def _field(log: FlightLog) -> tuple[tuple[float, float, float] | None, float]:
    """Return declination and inclination (rad), field strength (gauss), latitude (deg).

    Field values are those of the world magnetic model.
    """
    fixes = [g for g in log.gnss if np.isfinite(g.lat).any()]
    latitude = float(nanmedian(fixes[0].lat)) if fixes else 0.0
    model = alignment.earth_field(log)
    if model is None:
        return None, latitude
    return (
        (math.radians(model.declination_deg), math.radians(model.inclination_deg), model.strength_t * GAUSS_PER_TESLA),
        latitude,
    )


def rerun_row(
    case: Case,
    imu: Imu,
    spec: estimators.EstimatorSpec,
    name: str,
    calibration: Mapping[str, float] | None = None,
    compass: Mag | None = None,
    *,
    study: bool = False,
) -> tuple[Track, EstimatorRow]:
    """Re-run the onboard filter, with the values of ``spec`` over the log's parameters.

    ``calibration``: parameters of sensors that correct the samples instead of the flown ones. ``compass``: measures
    instead of the flown one. Changed rows run in the mode of :func:`study_mode`, as does the unchanged one that they
    are compared with (``study``). UsageError if the log lacks inputs.
    """
    changes = {key: float(value) for key, value in spec.params.items()}
    unchanged = not changes and not calibration and compass is None
    mode = study_mode(case, str(imu.index), spec.estimator.name) if study or not unchanged else "flown"
    found = run_again(case, imu, spec.estimator.name, changes, calibration, compass, mode)
    estimate = found.estimate(case.log.t0_us * 1e-6)
    row = reference.replayed(
        case.log,
        case.segments,
        case.reference,
        estimate,
        name=name,
        kind="rerun",
        estimator=spec.estimator.name,
        parameters=dict(spec.params),
        uses_mag=True,
    )
    row.imu, row.ns_per_update, row.aux = imu, None, dict(estimate.aux)
    row.aux[DIFFERENCE] = onboard_difference(case, estimate)
    row.mode = found.mode
    row.reproduction = reproduction(case, estimate, found.start) if unchanged else None
    from attlog.pipeline.replay import table_row

    return row, table_row(row, spec, {name: (value, "option") for name, value in spec.params.items()})


@per_case
def study_mode(case: Case, unit: str, name: str) -> Mode:
    """Return the mode in which changed parameters are studied on an IMU.

    It is ``own`` where the filter follows the flown attitude by its own rules: then resets and aiding may change with
    the parameters. Else it is ``flown``.
    """
    imu = next(i for i in case.imus.values() if str(i.index) == unit)
    found = run_again(case, imu, name, {}, mode="own")
    agreement = reproduction(case, found.estimate(case.log.t0_us * 1e-6), found.start)
    return "own" if agreement is not None and agreement.follows else "flown"


def run_again(
    case: Case,
    imu: Imu,
    name: str,
    changes: Mapping[str, float],
    calibration: Mapping[str, float] | None = None,
    compass: Mag | None = None,
    mode: Mode = "flown",
) -> Rerun:
    """Re-run a firmware's filter with parameters (full names) over the log's own.

    UsageError if the log is of another firmware, or lacks inputs.
    """
    inputs = flown_inputs(case, imu)
    if calibration or compass is not None:
        from attlog.pipeline.recalibrated_inputs import recalibrate_inputs, replace_compass

        inputs = inputs if compass is None else replace_compass(case.log, inputs, compass)
        inputs, _ = recalibrate_inputs(case.log, inputs, calibration or {})
    if name == "ap_ekf3":
        from attlog.estimators.ekf3.run import rerun as rerun_ekf3
        from attlog.flight.ardupilot.ekf3_inputs import Ekf3Inputs

        if not isinstance(inputs, Ekf3Inputs):
            raise UsageError("ap_ekf3 needs an ArduPilot log that EKF3 flew.")
        return rerun_ekf3(inputs, {EKF3.short(key): value for key, value in changes.items()}, mode=mode)
    from attlog.estimators.ekf2.run import rerun as rerun_ekf2
    from attlog.flight.px4.ekf2_inputs import Ekf2Inputs

    if not isinstance(inputs, Ekf2Inputs):
        raise UsageError("px4_ekf2 needs a PX4 log that EKF2 flew.")
    short = {EKF2.short(key): value for key, value in changes.items()}
    return rerun_ekf2(inputs, *_field(case.log), short, gnss_hz=gnss_rate_of(case, ""), mode=mode)


def first_lane_switch(log: FlightLog) -> float | None:
    """Return the time in s of the first switch of EKF lanes."""
    lanes = log.estimator.lane
    return float(lanes.t[1]) if lanes is not None and len(lanes.t) > 1 else None


def onboard_difference(case: Case, estimate: Estimate) -> Array:
    """Return time, tilt and signed heading of a re-run minus the onboard attitude.

    Shape (m, 3), in s and deg, at the records of the EKF lane that flew first. Empty where there are too few.
    """
    onboard = case.log.onboard_attitude
    if onboard is None or len(estimate.t) < 2:
        return np.zeros((0, 3))
    t = onboard.t if onboard.t_sample is None else onboard.t_sample
    inside = (t >= estimate.t[0]) & (t <= estimate.t[-1])
    until = first_lane_switch(case.log)
    if until is not None:
        inside &= t < until
    if np.count_nonzero(inside) < MIN_RECORDS:
        return np.zeros((0, 3))
    flown = alignment.untrim(onboard.q[inside], case.log.parameters.trim if onboard.has_trim else None)
    error = rotation.earth_error(rotation.slerp(estimate.t, estimate.q, t[inside]), flown)
    return np.column_stack(
        [t[inside], np.degrees(rotation.tilt_angle(error)), np.degrees(rotation.heading_angle(error))]
    )


def reproduction(case: Case, estimate: Estimate, start: str) -> Reproduction | None:
    """Compare a re-run with the onboard attitude in the air.

    Over the whole log if it is short in the air; None where they share no time.
    """
    t, tilt, heading = onboard_difference(case, estimate).T
    if not len(t):
        return None
    heading = np.abs(heading)
    air = case.segments.mask(t, "airborne")
    period = float(median(np.diff(t)))
    airborne = bool(air.sum() * period >= MIN_AIRBORNE_S)
    use = air if airborne else np.ones(len(tilt), bool)
    apart = np.flatnonzero(use & ((tilt > MAX_TILT_P95_DEG) | (heading > 2 * MAX_HEADING_MEDIAN_DEG)))
    middle, p95 = np.array([quantile(x[use], [0.5, 0.95]) for x in (tilt, heading)]).T.tolist()
    return Reproduction(
        middle[0],
        p95[0],
        middle[1],
        p95[1],
        int(use.sum()),
        float(use.sum() * period),
        airborne,
        start,
        middle[0] <= MAX_TILT_MEDIAN_DEG and p95[0] <= MAX_TILT_P95_DEG and middle[1] <= MAX_HEADING_MEDIAN_DEG,
        float(t[apart[0]]) if len(apart) else None,
        first_lane_switch(case.log),
    )


def traces_of(case: Case, row: Track) -> list[Trace]:
    """Return traces of a re-run beside the logged states of the onboard filter."""
    imu = row.imu
    logged = logged_tables(flown_inputs(case, imu) if imu is not None else inputs_of(case, ""))
    for table in logged.values():
        table[:, 0] -= case.log.t0_us * 1e-6
    return rerun_traces(case, row, logged)
