"""How closely EKF2 and EKF3 run again follow what flew, and whether planted faults are found.

``python benchmarks/rerun.py LOG ...`` prints a row a log: firmware and start, logged rates of IMU, field and GNSS,
differences of tilt and heading to the onboard attitude in the air as median / 95 % in deg, with resets and GNSS use as
logged and (own) by the filter's rules, re-run over logged sigmas (tilt, yaw, velocity, gyro bias xy and z,
accelerometer bias), CPU per 100 s. The medians of the sigmas over all logs follow.

``python benchmarks/rerun.py --planted LOG ...`` (simulated PX4 flights with truth) prints a row a flight: RMS error
against truth, re-run minus onboard, in deg; gyro bias, median difference in deg/s; what innovations give back of a
GNSS delay of 150 ms, a field delay of 100 ms, a compass offset of 54 mG (what is left of it), noises of 0.05 G and
0.6 m/s; correlation of a parameter's effect on the log thinned to 2 Hz of field and GNSS with that on the full one
(median and least of six parameters); differences as above with half the IMU's rate.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import attlog
from attlog.core import rotation
from attlog.core.errors import AttlogError, UsageError
from attlog.estimators.ekf2 import run as ekf2
from attlog.estimators.ekf3 import run as ekf3
from attlog.estimators.rerun import Mode, Rerun, logged_tables
from attlog.flight.px4.ekf2_inputs import Ekf2Inputs
from attlog.metrics.metric import Case
from attlog.pipeline import onboard_rerun
from attlog.reference.model import Reproduction

Array = NDArray[np.float64]
# First seconds after a start, which are not compared.
SETTLING_S = 20.0
VELOCITY, FIELD = ("velocity_n", "velocity_e"), ("mag_x", "mag_y", "mag_z")
# Columns of the inputs beside the innovations of VELOCITY.
GNSS_COLUMNS = ("vn", "ve")
# Planted: delays in s, offset in gauss, standard deviations in gauss and m/s.
GNSS_DELAY_S, FIELD_DELAY_S, OFFSET_GAUSS = 0.15, 0.1, np.array([0.03, -0.02, 0.04])
FIELD_NOISE_GAUSS, VELOCITY_NOISE_M_S = 0.05, 0.6
# Changes whose effect is compared between a full and a thinned log.
CHANGES = (
    {"MAG_NOISE": 0.15},
    {"GPS_V_NOISE": 1.0},
    {"ACC_NOISE": 1.0},
    {"GYR_NOISE": 0.05},
    {"GPS_DELAY": 100.0},
    {"MAG_DELAY": 80.0},
)
THINNED_HZ = 2.0


def prepared(path: str) -> tuple[Case, Any]:
    """Return a log and the inputs of the filter that flew."""
    case = attlog.prepare(path)
    imu = case.log.replay_imu
    if not onboard_rerun.flown_filter(case.log) or imu is None:
        raise UsageError("no filter flew that is run again")
    return case, onboard_rerun.flown_inputs(case, imu)


def again(case: Case, inputs: Any, changes: Mapping[str, float] | None = None, mode: Mode = "flown") -> Rerun:
    """Run the filter on inputs with changes by the parameters' short names."""
    if not isinstance(inputs, Ekf2Inputs):
        return ekf3.rerun(inputs, dict(changes or {}), mode=mode)
    rate = onboard_rerun.gnss_rate_of(case, "")
    return ekf2.rerun(inputs, *onboard_rerun._field(case.log), changes, gnss_hz=rate, mode=mode)


def followed(case: Case, found: Rerun) -> Reproduction | None:
    """Return the difference to the onboard attitude."""
    return onboard_rerun.reproduction(case, found.estimate(case.log.t0_us * 1e-6), found.start)


def sigma_ratios(found: Rerun, inputs: Any) -> Array:
    """Return medians of re-run over logged sigmas (6,); NaN if they are not logged."""
    if inputs.states is None:
        return np.full(6, np.nan)
    sigma = logged_tables(inputs)["sigma"]
    if isinstance(inputs, Ekf2Inputs):
        t, logged = inputs.states.t, inputs.states.covariances
        first, per_step = (3, False) if found.facts["era"] > 2 else (4, True)
    else:
        t, logged, first, per_step = inputs.states.t_variances, inputs.states.variances, 4, True
    theta, v, bg, ba = (found.states[f"{n}_variance"] for n in ("attitude", "velocity", "gyro_bias", "acc_bias"))
    scale = found.facts["step_s"] ** 2 if per_step else 1.0

    def ratio(t: Array, ours: Array, logged: Array) -> float:
        k = np.clip(np.searchsorted(found.t_step, t), 0, len(found.t_step) - 1)
        known = found.t_step[np.isfinite(found.states["gnss"])]
        use = (t > known[0] + SETTLING_S) & (t < known[-1]) & (logged > 0.0) & (ours[k] > 0.0)
        return float(np.sqrt(np.median(ours[k][use] / logged[use]))) if use.any() else np.nan

    return np.array(
        [
            ratio(sigma[:, 0], theta[:, 0] + theta[:, 1], sigma[:, 1] ** 2),
            ratio(sigma[:, 0], theta[:, 2], sigma[:, 2] ** 2),
            ratio(t, v[:, 0] + v[:, 1], logged[:, first] + logged[:, first + 1]),
            ratio(t, (bg[:, 0] + bg[:, 1]) * scale, logged[:, first + 6] + logged[:, first + 7]),
            ratio(t, bg[:, 2] * scale, logged[:, first + 8]),
            ratio(t, ba.sum(axis=1) * scale, logged[:, first + 9 : first + 12].sum(axis=1)),
        ]
    )


def rates(inputs: Any) -> str:
    """Return the logged rates of IMU, field and GNSS in Hz."""
    imu = inputs.imu.t if isinstance(inputs, Ekf2Inputs) else inputs.t
    streams = (imu, inputs.mag["t"], inputs.gnss["t"])
    return " / ".join(f"{1 / np.median(np.diff(t)):.0f}" if len(t) > 2 else "-" for t in streams)


def differences(found: Reproduction) -> str:
    """Return tilt and heading, median / 95 %, in deg."""
    return (
        f"{found.tilt_median_deg:.2f} / {found.tilt_p95_deg:.2f} "
        f"| {found.heading_median_deg:.2f} / {found.heading_p95_deg:.2f}"
    )


def row(path: str, ratios: list[Array]) -> str:
    """Return a log's line of the first table; its ratios of sigmas are appended."""
    name = path.rpartition("/")[2]
    try:
        case, inputs = prepared(path)
        again(case, inputs)  # the first use may compile
        begin = time.process_time()
        found = again(case, inputs)
        cost = time.process_time() - begin
        same, own = followed(case, found), followed(case, again(case, inputs, mode="own"))
    except AttlogError as error:
        return f"| {name} | {error} | | | | | |"
    if same is None or own is None:
        return f"| {name} | no attitude to compare with | | | | | |"
    ratios.append(sigma_ratios(found, inputs))
    sigmas = " ".join(f"{ratio:.2f}" for ratio in ratios[-1] if np.isfinite(ratio))
    span = found.t[np.isfinite(found.q[:, 0])]
    return (
        f"| {name} | {'.'.join(map(str, inputs.version))}, {found.start}{'' if same.airborne else ', ground'} "
        f"| {rates(inputs)} | {differences(same)} "
        f"| {own.tilt_median_deg:.2f} {own.heading_median_deg:.2f}{'' if own.follows else ' flown'} "
        f"| {sigmas} | {100 * cost / float(span[-1] - span[0]):.2f} |"
    )


def rms(found: Rerun, aids: tuple[str, ...]) -> float:
    """Return the root mean square of the innovations of aids after settling."""
    tables = [found.innovations[aid] for aid in aids]
    e = np.concatenate([x[x[:, 0] > found.t[0] + SETTLING_S, 1] for x in tables])
    return float(np.sqrt(np.mean(e**2)))


def surprise(found: Rerun, aids: tuple[str, ...]) -> float:
    """Return the negative log likelihood of the innovations of aids after settling."""
    x = np.concatenate([found.innovations[aid] for aid in aids])
    x = x[x[:, 0] > found.t[0] + SETTLING_S]
    return float(np.sum(np.log(x[:, 2]) + x[:, 1] ** 2 / x[:, 2]))


def least(cost: Callable[[float], float], values: Array) -> float:
    """Return where a cost is least: the vertex of the parabola about the least of ``values``."""
    costs = np.array([cost(float(value)) for value in values])
    i = int(np.clip(np.argmin(costs), 1, len(values) - 2))
    a, b, _ = np.polyfit(values[i - 1 : i + 2], costs[i - 1 : i + 2], 2)
    return float(np.clip(-b / (2.0 * a), values[0], values[-1])) if a > 0.0 else float(values[np.argmin(costs)])


def found_delays(case: Case, inputs: Ekf2Inputs) -> tuple[float, float]:
    """Plant delays of GNSS and field; return those in s of the least innovations."""
    gnss = {**inputs.gnss, "t": inputs.gnss["t"] + GNSS_DELAY_S}
    mag = {**inputs.mag, **{name: inputs.mag[name] + FIELD_DELAY_S for name in ("t", "t_arrival")}}
    found = []
    for late, name, aids in (
        (replace(inputs, gnss=gnss), "GPS_DELAY", VELOCITY),
        (replace(inputs, mag=mag), "MAG_DELAY", FIELD),
    ):

        def cost(ms: float, late: Ekf2Inputs = late, name: str = name, aids: tuple[str, ...] = aids) -> float:
            return rms(again(case, late, {name: ms, "DELAY_MAX": 400.0}), aids)

        found.append(1e-3 * least(cost, np.arange(0.0, 301.0, 25.0)))
    return found[0], found[1]


def found_offset(case: Case, inputs: Ekf2Inputs) -> Array:
    """Plant a compass offset; return by how much the filter's own offset changes, in gauss."""
    planted = replace(inputs, mag={**inputs.mag, "x": inputs.mag["x"] + OFFSET_GAUSS})
    before, after = (again(case, x).states["field_bias"] for x in (inputs, planted))
    last = np.flatnonzero(np.isfinite(before[:, 0]) & np.isfinite(after[:, 0]))[-1]
    return np.asarray(after[last] - before[last])


def found_noises(case: Case, inputs: Ekf2Inputs) -> tuple[float, float]:
    """Plant white noise on field and GNSS velocity; return the most likely MAG_NOISE and GPS_V_NOISE."""
    rng = np.random.default_rng(1)
    field = inputs.mag["x"] + FIELD_NOISE_GAUSS * rng.standard_normal(inputs.mag["x"].shape)
    n = len(inputs.gnss["t"])
    gnss = {name: inputs.gnss[name] + VELOCITY_NOISE_M_S * rng.standard_normal(n) for name in GNSS_COLUMNS}
    # the filter takes the larger of the receiver's accuracy and the parameter
    gnss = {**inputs.gnss, **gnss, "sacc": np.zeros(n)}
    noisy = replace(inputs, mag={**inputs.mag, "x": field}, gnss=gnss)
    found = []
    for name, gate, planted, aids in (
        ("MAG_NOISE", "MAG_GATE", FIELD_NOISE_GAUSS, FIELD),
        ("GPS_V_NOISE", "GPS_V_GATE", VELOCITY_NOISE_M_S, VELOCITY),
    ):

        def cost(
            octaves: float, name: str = name, gate: str = gate, planted: float = planted, aids: Any = aids
        ) -> float:
            return surprise(again(case, noisy, {name: planted * 2.0**octaves, gate: 50.0}), aids)

        found.append(planted * 2.0 ** least(cost, np.arange(-1.5, 1.6, 0.5)))
    return found[0], found[1]


def effect(case: Case, inputs: Ekf2Inputs, changes: Mapping[str, float]) -> Array:
    """Return how changes turn the attitude about north, east and down, in deg at the IMU's times."""
    flown, changed = again(case, inputs), again(case, inputs, changes)
    use = np.isfinite(flown.q[:, 0]) & np.isfinite(changed.q[:, 0]) & (flown.t > flown.t[0] + SETTLING_S)
    e = rotation.earth_error(changed.q[use], flown.q[use])
    return np.asarray(np.degrees(2.0 * np.sign(e[:, :1]) * e[:, 1:]))


def thinned(inputs: Ekf2Inputs) -> Ekf2Inputs:
    """Leave 2 Hz of field and GNSS, as a log of default settings has."""

    def thin(stream: Mapping[str, Array]) -> dict[str, Array]:
        every = max(1, round(1.0 / float(np.median(np.diff(stream["t"]))) / THINNED_HZ))
        return {column: x[::every] for column, x in stream.items()}

    return replace(inputs, mag=thin(inputs.mag), gnss=thin(inputs.gnss))


def correlations(case: Case, inputs: Ekf2Inputs) -> Array:
    """Return correlations of effects on the thinned and the full log: (parameters, 2) of tilt and heading."""
    found = []
    for changes in CHANGES:
        full, thin = (effect(case, x, changes) for x in (inputs, thinned(inputs)))
        pairs = (full[:, :2].ravel(), thin[:, :2].ravel()), (full[:, 2], thin[:, 2])
        found.append([np.corrcoef(*pair)[0, 1] for pair in pairs])
    return np.array(found)


def halved(inputs: Ekf2Inputs) -> Ekf2Inputs:
    """Average the IMU over pairs of samples."""
    imu = inputs.imu
    n = len(imu.t) // 2
    dt = imu.dt[: 2 * n].reshape(n, 2)

    def mean(x: Array) -> Array:
        return np.asarray((x[: 2 * n].reshape(n, 2, 3) * dt[:, :, None]).sum(axis=1) / dt.sum(axis=1)[:, None])

    clip = imu.clip[: 2 * n : 2] | imu.clip[1 : 2 * n : 2]
    return replace(
        inputs,
        imu=replace(imu, t=imu.t[1 : 2 * n : 2], dt=dt.sum(axis=1), gyro=mean(imu.gyro), acc=mean(imu.acc), clip=clip),
    )


def bias_difference(found: Rerun, inputs: Ekf2Inputs) -> float:
    """Return the median difference of the gyro bias to the logged one, of the worst axis, in deg/s."""
    t = inputs.bias["t"] - (inputs.horizon or 0.0)
    k = np.clip(np.searchsorted(found.t_step, t), 0, len(found.t_step) - 1)
    apart = found.states["gyro_bias"][k] - np.column_stack([inputs.bias[axis] for axis in "xyz"])
    settled = (t > found.t[0] + SETTLING_S) & np.isfinite(apart[:, 0])
    return float(np.degrees(np.median(np.abs(apart[settled]), axis=0).max()))


def truth_difference(path: str) -> tuple[float, float]:
    """Return RMS errors of tilt and heading against truth in the air, re-run minus onboard, in deg."""
    rows = {row.name: row for row in attlog.analyze(path, {"estimators": ["px4_ekf2"]}).estimators}
    errors = [
        [rows[name].metrics["airborne"][metric].value or np.nan for metric in ("tilt_rmse_deg", "heading_rmse_deg")]
        for name in ("px4_ekf2", "onboard")
    ]
    return errors[0][0] - errors[1][0], errors[0][1] - errors[1][1]


def planted_row(path: str) -> str:
    """Return a flight's line of the second table."""
    case, inputs = prepared(path)
    tilt, heading = truth_difference(path)
    bias, left = bias_difference(again(case, inputs), inputs), found_offset(case, inputs) - OFFSET_GAUSS
    gnss_s, field_s = found_delays(case, inputs)
    field, velocity = found_noises(case, inputs)
    both = correlations(case, inputs)
    half = followed(case, again(case, halved(inputs)))
    assert half is not None
    return (
        f"| {path.rpartition('/')[2]} | {tilt:+.2f} {heading:+.2f} | {bias:.3f} "
        f"| {1e3 * gnss_s:.0f} | {1e3 * field_s:.0f} "
        f"| {1e3 * np.linalg.norm(left):.0f} "
        f"| {field:.3f} {velocity:.2f} "
        f"| {np.median(both[:, 0]):.2f} {both[:, 0].min():.2f}, {np.median(both[:, 1]):.2f} {both[:, 1].min():.2f} "
        f"| {differences(half).replace(' | ', ', ')} |"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--planted", action="store_true", help="plant faults in simulated PX4 flights")
    parser.add_argument("logs", nargs="+", metavar="LOG")
    options = parser.parse_args()
    if options.planted:
        print("| flight | truth | bias | GNSS, ms | field, ms | offset left, mG | noises | thinned | half the IMU |")
        print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
        for log in options.logs:
            print(planted_row(log), flush=True)
    else:
        print("| log | version, start | Hz | tilt, deg | heading, deg | own | sigmas | CPU s per 100 s |")
        print("| --- | --- | --- | --- | --- | --- | --- | --- |")
        all_ratios: list[Array] = []
        for log in options.logs:
            print(row(log, all_ratios), flush=True)
        if np.isfinite(all_ratios).any():
            print("median sigmas:", " ".join(f"{x:.2f}" for x in np.nanmedian(np.array(all_ratios), axis=0)))
