"""Correct the logged inputs of an onboard filter by another calibration of their sensors."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.earth import GAUSS_PER_TESLA
from attlog.core.sorting import median, unique
from attlog.estimators.ekf2.parameters import era_of
from attlog.estimators.ekf2.parameters import settings_of as ekf2_settings
from attlog.estimators.ekf2.run import predict_seconds
from attlog.estimators.ekf2.state import ERA_D
from attlog.estimators.ekf3.parameters import settings_of as ekf3_settings
from attlog.flight import recalibration
from attlog.flight.ardupilot.ekf3_inputs import Ekf3Inputs
from attlog.flight.calibration import CalibrationUnknownError
from attlog.flight.model import FlightLog, Mag

Array = NDArray[np.float64]
# Parameters that calibrate a sensor, by the firmwares' names.
SENSOR_PARAMETERS = {
    "gyro": re.compile(r"INS\d?_GYR\d?OFFS_.|CAL_GYRO\d_.OFF"),
    "acc": recalibration.ACCELEROMETER_PARAMETERS,
    "compass": recalibration.COMPASS_PARAMETERS,
}
SENSOR_NAMES = {"acc": "accelerometer"}
# Index of the first of three states in the filters' order.
GYRO_BIAS, ACC_BIAS, BODY_FIELD = 10, 13, 19
# Largest difference of time (s) and field (T) of one sample read twice.
SAME_SAMPLE_S, SAME_FIELD_T = 1e-4, 1e-10


def recalibrate_inputs(log: FlightLog, inputs: Any, given: Mapping[str, float]) -> tuple[Any, list[str]]:
    """Return a filter's inputs as sensors calibrated by ``given`` would have measured, with remarks.

    The flown calibration is undone on the logged samples, and the new one applied. Logged biases, from which a warm
    start begins, move by the mean change: the filter would have learned them so. A remark names each parameter that
    differs from the log's, and whether it is applied or why not.
    """
    differ = recalibration.changed_parameters(log, given)
    imu_samples = inputs if isinstance(inputs, Ekf3Inputs) else inputs.imu
    is_ekf3 = isinstance(inputs, Ekf3Inputs)
    units = (i for i in log.imus if (i.index == inputs.unit if is_ekf3 else i.gyro.source == "sensor_combined"))
    imu = next(units, None)
    mag, samples, shifts = dict(inputs.mag), {"gyro": imu_samples.gyro, "acc": imu_samples.acc}, {}
    remarks, known = [], set()

    def corrected(sensor: str, rows: Any, t: Array, x: Array, find: Any, state: int) -> Array:
        """Return samples with a sensor's change applied, and note it."""
        try:
            found = find(differ)
        except CalibrationUnknownError as why:
            names = [n for n in differ if SENSOR_PARAMETERS[sensor].match(n)]
            known.update(names)
            if names:
                remarks.append(f"{recalibration.changes_text(log, names, differ)}: not applied. {why}")
            return x
        if found is None:
            return x
        known.update(found.changed)
        remarks.append(
            f"{SENSOR_NAMES.get(sensor, sensor)} corrected by {recalibration.changes_text(log, found.changed, differ)}"
        )
        out = x.copy()
        out[rows] = found.corrected(t[rows], x[rows])
        shifts[state] = np.nanmean(out - x, axis=0)
        return out

    t0 = log.t0_us * 1e-6
    if imu is not None:
        t = imu_samples.t - t0
        for sensor, find, state in (
            ("gyro", partial(recalibration.gyro_recorrection, log, imu), GYRO_BIAS),
            ("acc", partial(recalibration.accelerometer_recorrection, log, imu), ACC_BIAS),
        ):
            samples[sensor] = corrected(sensor, slice(None), t, samples[sensor], find, state)
    if len(mag["t"]):
        t, x = mag["t"] - t0, mag["x"] / GAUSS_PER_TESLA
        owner = _compass_of_samples(log, t, x)
        for k in unique(owner).tolist():
            find = partial(recalibration.compass_recorrection, log, log.mags[k])
            x = corrected("compass", owner == k, t, x, find, BODY_FIELD)
        if BODY_FIELD in shifts:
            mag["x"] = x * GAUSS_PER_TESLA
    others = [n for n in differ if n not in known]
    if others:
        remarks.append(f"{recalibration.changes_text(log, others, differ)}: no sample of this re-run changes by it")
    if not is_ekf3:
        samples = {"imu": replace(inputs.imu, **samples)}
    return replace(inputs, mag=mag, states=_shifted_states(inputs, shifts), **samples), remarks


def replace_compass(log: FlightLog, inputs: Any, mag: Mag) -> Any:
    """Return a filter's inputs with the samples of another compass.

    The logged body field, from which a warm start begins, moves by the mean difference.
    """
    good = rotation.finite_rows(mag.field.x) & np.isfinite(mag.field.t_best)
    t, x = mag.field.t_best[good] + log.t0_us * 1e-6, mag.field.x[good] * GAUSS_PER_TESLA
    columns = {"t": t, "x": x}
    if "t_arrival" in inputs.mag:
        columns["t_arrival"] = t + float(median(inputs.mag["t_arrival"] - inputs.mag["t"]))
    if "unit" in inputs.mag:
        columns["unit"] = np.full(len(t), -1.0)
    used = np.column_stack([np.interp(t, inputs.mag["t"], axis) for axis in inputs.mag["x"].T])
    shift = np.mean(x - used, axis=0) / GAUSS_PER_TESLA
    return replace(inputs, mag=columns, states=_shifted_states(inputs, {BODY_FIELD: shift}))


def _compass_of_samples(log: FlightLog, t: Array, x: Array) -> NDArray[np.int64]:
    """Return the index in ``log.mags`` of the compass of each sample ``x`` (n, 3) T; unknown ones as the one before."""
    owner = np.full(len(t), -1)
    for k, mag in enumerate(log.mags):
        at = np.clip(np.searchsorted(mag.field.t_best, t - SAME_SAMPLE_S), 0, len(mag.field.t) - 1)
        same = np.abs(mag.field.t_best[at] - t) < SAME_SAMPLE_S
        owner[same & (np.abs(mag.field.x[at] - x).max(axis=1) < SAME_FIELD_T)] = k
    known = np.flatnonzero(owner >= 0)
    if not len(known):
        return np.zeros(len(t), np.int64) if log.mags else np.zeros(0, np.int64)
    return owner[known[np.clip(np.searchsorted(known, np.arange(len(t)), side="right") - 1, 0, None)]]


def _shifted_states(inputs: Any, shifts: Mapping[int, Array]) -> Any:
    """Return logged states with biases moved by ``shifts`` (3,), by the index of the first of three.

    A body field moves where it was learned, by the share that its variance says.
    """
    logged = inputs.states
    if logged is None or not shifts:
        return logged
    if isinstance(inputs, Ekf3Inputs):
        x, t, variances, t_variances, first = logged.x.copy(), logged.t, logged.variances, logged.t_variances, 0
        noise, per = ekf3_settings(inputs.params, inputs.version, inputs.plane)["MAG_M_NSE"], 1.0
    else:
        x, t, variances, t_variances = logged.states.copy(), logged.t, logged.covariances, logged.t
        setting, era = ekf2_settings(inputs.params, inputs.version), era_of(inputs.version)
        first, noise = (1 if era == ERA_D else 0), setting["MAG_NOISE"]
        per = predict_seconds(inputs.version, setting) if era < ERA_D else 1.0
    for state, shift in shifts.items():
        if state != BODY_FIELD:
            x[:, state : state + 3] += per * shift
            continue
        share = np.ones((len(t), 3))
        if len(t_variances):
            at = np.clip(np.searchsorted(t_variances, t), 0, len(t_variances) - 1)
            share = np.clip(1.0 - variances[at, state - first : state - first + 3] / noise**2, 0.0, 1.0)
        learned = np.any(x[:, state : state + 3] != 0.0, axis=1)[:, None]
        x[:, state : state + 3] += np.where(learned, share, 0.0) * shift * GAUSS_PER_TESLA
    return replace(logged, **({"x": x} if isinstance(inputs, Ekf3Inputs) else {"states": x}))
