"""Noise levels and priors for every vehicle, and a run's samples and aids made ready."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from attlog.core import earth
from attlog.core.sorting import median
from attlog.estimators.aids import Aids, Measurements
from attlog.estimators.filters.navigation.model import GROUPS, Motion, Settings
from attlog.estimators.interface import Array, Parameter

MEASURED = "attlog; measured on simulated flights of both firmwares"
PRIORS = (
    Parameter("gyro_bias_sigma", 1.0, "deg/s", 0.001, 20, "spread of the gyro bias where no rest shows it", MEASURED),
    Parameter("acc_bias_sigma", 0.1, "m/s^2", 0.001, 2, "spread of the accelerometer bias", MEASURED),
    Parameter("declination_sigma", 0.6, "deg", 0.01, 20, "spread of the declination around the model's", MEASURED),
)
# Parameters of ``eskf`` and ``smoother`` alike.
GATE = Parameter("soft_gate", 2.5, "", 1, 100, "innovations beyond so many sigma count less", MEASURED)
# Longest time between nodes, and between those of a smoothed attitude, whose correction holds from node to node.
NODE_S, FINE_S = 0.04, 0.02
MAG_BLOCK_S, BARO_BLOCK_S = 0.04, 0.05
HARD_SIGMA = 30.0
WANDER_S, WANDER_M = 100.0, 1.0
# How far the gyro bias may jump where it does, one sigma.
JUMP_RAD_S = np.deg2rad(3.0)
REST_SPEED, REST_EVERY_S, REST_MEAN_S = 0.02, 0.2, 0.2
# Receivers are never better: a GNSS of 4 mm/s would make timing errors look like information. m/s, m, m, G, rad/s.
MIN_R = (0.02, 0.02, 0.03, 0.03, 0.02, 0.001, 1e-6, REST_SPEED)
START_R = (0.1, 0.1, 0.5, 0.5, 0.3, 0.010, 1e-4, REST_SPEED)


@dataclass(frozen=True, slots=True)
class PriorSpreads:
    """Standard deviations at the start: SI units, field in gauss, angles in rad, soft iron and scale as parts of 1."""

    gyro_bias_rest: float = np.deg2rad(0.3)
    gyro_bias: float = np.deg2rad(1.0)
    acc_bias: float = 0.1
    declination: float = np.deg2rad(0.6)
    field_size: float = 0.015
    hard: float = 0.010
    soft: float = 0.006
    arm: float = 0.03
    scale: float = 0.005
    gnss_delay: float = 0.08
    mag_delay: float = 0.03
    wander: float = WANDER_M
    baro: float = 5.0


@dataclass(frozen=True, slots=True)
class NoiseLevels:
    """Noise levels, delays and prior spreads: where a run starts from and what calibration finds.

    ``r`` (8,) standard deviations of the groups of :mod:`layout`; densities ``gyro`` rad/s/sqrt(Hz), ``acc``
    m/s^2/sqrt(Hz), random walks of the biases per sqrt(s); ``gnss_delay``, ``mag_delay`` s.
    """

    r: Array = field(default_factory=lambda: np.array(START_R))
    gyro: float = 5e-4
    acc: float = 0.03
    acc_rest: float = 3e-3
    gyro_walk: float = 1e-5
    acc_walk: float = 3e-4
    hard_walk: float = 20e-6
    wander_walk: float = WANDER_M * np.sqrt(2.0 / WANDER_S)
    baro_walk: float = 0.05
    gnss_delay: float = 0.12
    mag_delay: float = 0.0
    prior: PriorSpreads = PriorSpreads()

    def settings(self, gravity: float, soft_gate: float) -> Settings:
        """Return the numbers as the loops take them."""
        return Settings(
            gravity=gravity,
            q_gyro=self.gyro,
            q_acc=self.acc,
            q_acc_rest=self.acc_rest,
            q_bg=self.gyro_walk,
            q_ba=self.acc_walk,
            q_hard=self.hard_walk,
            q_wander=self.wander_walk,
            q_baro=self.baro_walk,
            wander_tau=WANDER_S,
            soft_gate=soft_gate,
            hard_gate=HARD_SIGMA,
        )


def started(params: Mapping[str, float | str]) -> NoiseLevels:
    """Return the defaults with what a user may set by hand."""
    prior = PriorSpreads(
        gyro_bias=np.deg2rad(float(params["gyro_bias_sigma"])),
        acc_bias=float(params["acc_bias_sigma"]),
        declination=np.deg2rad(float(params["declination_sigma"])),
    )
    return replace(NoiseLevels(), prior=prior)


assert len(START_R) == len(MIN_R) == GROUPS


# What a run was given, made ready: inertial samples at their own times, and aids in local axes with block means.
#
# Earth axes are turned so that "north" is the direction to which the estimator's ``declination`` will be added
# afterwards: GNSS vectors are turned back by it here. Fields are in gauss.

GRAVITY = 9.80665
TYPICAL_FIELD_G = 0.5
# Samples further from the median are faults; a median further from the model is a unit or scale fault.
MAX_FIELD_DEVIATION, MAX_FIELD_BIAS = 0.6, 0.07
EQUATOR_M, FLATTENING = 6378137.0, 1.0 / 298.257223563
MIN_FIXES = 5
# Take-off and touch-down stay out of rest.
REST_EDGE_S = 0.5
# Short means of the gyro that differ by more than this from the first few are no rest.
SHORT_S, FIRST_MEANS, MAX_REST_DIFFERENCE_RAD_S = 0.2, 3, np.deg2rad(3.0)
# What a run may know of a sensor's level before it begins, where it may not look ahead.
FIRST_S = 2.0


@dataclass(slots=True)
class Inputs:
    """A run's samples: ``t`` (n,) s when attitudes are asked for, ``lag`` s by how much the samples are older.

    ``dt`` (n,), ``gyr``, ``acc`` (n, 3) as the model takes them, ``rest`` (n,) 1 where the interval before is rest;
    ``still`` (n,) the same without margins. ``velocity``, ``position``, ``baro``, ``mag`` in local axes, None where
    missing; ``field`` (3,) G is the earth's by a model, None where unknown.
    """

    t: Array
    lag: float
    dt: Array
    gyr: Array
    acc: Array
    rest: NDArray[np.int8]
    still: NDArray[np.bool_]
    velocity: Measurements | None
    position: Measurements | None
    baro: Measurements | None
    mag: Measurements | None
    field: Array | None
    gravity: float
    # When the samples were taken, s.
    sensed_at: Array = dataclasses.field(init=False)

    def __post_init__(self) -> None:
        self.sensed_at = self.t - self.lag

    def part(self, begin: int, end: int) -> Inputs:
        """Return the samples ``begin`` to ``end`` with their aids, as a run of their own."""
        own, (a, b) = slice(begin, end), self.sensed_at[[begin, end - 1]]
        dt = self.dt[own].copy()
        dt[:1] = 0.0
        velocity, position, baro, mag = (
            None if m is None else m.between(a, b) for m in (self.velocity, self.position, self.baro, self.mag)
        )
        return Inputs(
            self.t[own],
            self.lag,
            dt,
            self.gyr[own],
            self.acc[own],
            self.rest[own],
            self.still[own],
            velocity,
            position,
            baro,
            mag,
            self.field,
            self.gravity,
        )

    @property
    def motion(self) -> Motion:
        """The samples as the loops take them."""
        return Motion(self.dt, self.gyr, self.acc, self.rest)

    @property
    def aided_by(self) -> str:
        """What helps beside gyro and accelerometer."""
        aids = {"gnss": self.velocity, "position": self.position if self.velocity is None else None}
        aids |= {"baro": self.baro, "mag": self.mag}
        return " ".join([*(n for n, m in aids.items() if m is not None), *(["rest"] if self.rest.any() else [])])


def prepare_inputs(t: Array, gyr: Array, acc: Array, mag: Array, aids: Aids, declination: float, ahead: bool) -> Inputs:
    """Prepare the inputs of one segment: ``t`` (n,) s, ``gyr`` rad/s, ``acc`` m/s^2, ``mag`` (n, 3) with NaN rows.

    ``declination`` rad; ``ahead``: whether levels may be taken from the whole run.
    """
    lag, lag_acc = aids.lag
    f = _filled(t, acc)
    if aids.sampling == "instant" and len(t) > 1:
        f = np.vstack([f[:1], 0.5 * (f[1:] + f[:-1])])
    if lag_acc != lag:
        f = np.column_stack([np.interp(t + (lag_acc - lag), t, f[:, i]) for i in range(3)])
    sensed = t - lag
    rest, still = resting(sensed, gyr, aids.at_rest)
    velocity, position = gnss(aids, declination, sensed, ahead)
    field = None if aids.field is None else 1e4 * np.asarray(aids.field)
    if field is not None and declination != 0.0:
        level = math.hypot(field[0], field[1])
        field = np.array([level, 0.0, field[2]])
    place = aids.position
    gravity = GRAVITY
    if place is not None:
        lat, alt = float(median(place.x[:, 0])), place.x[np.isfinite(place.x[:, 2]), 2]
        gravity = earth.gravity(lat if ahead else float(place.x[0, 0]), float(alt[0]) if len(alt) else 0.0)
    return Inputs(
        t,
        lag,
        np.diff(t, prepend=t[:1]),
        np.ascontiguousarray(gyr),
        np.ascontiguousarray(f),
        rest,
        still,
        velocity,
        position,
        _baro(aids),
        _mag(t, mag, field, ahead),
        field,
        gravity,
    )


def resting(t: Array, gyr: Array, spans: Array | None) -> tuple[NDArray[np.int8], NDArray[np.bool_]]:
    """Select sample intervals (n,) at rest: with half a second of margin on both sides, and without.

    ``t`` (n,) s, ``gyr`` (n, 3) rad/s, ``spans`` (k, 2) s in which the vehicle says that it stands.
    A span ends where the gyro contradicts it.
    """
    rest, still = np.zeros(len(t), bool), np.zeros(len(t), bool)
    for a, b in np.zeros((0, 2)) if spans is None else spans:
        k, e = (int(i) for i in np.searchsorted(t, [a, np.nextafter(b, np.inf)]))
        if e - k < 2:
            continue
        grid = np.arange(t[k], t[e - 1], SHORT_S)
        mean = RunningMean(t[k:e], gyr[k:e]).mean(grid, grid + SHORT_S)
        begin = np.mean(mean[:FIRST_MEANS], axis=0)
        turning = np.flatnonzero(np.sqrt(np.sum((mean - begin) ** 2, axis=1)) > MAX_REST_DIFFERENCE_RAD_S)
        end = b if len(turning) == 0 else float(grid[turning[0]]) - SHORT_S
        begins = int(np.searchsorted(t, a + REST_EDGE_S, side="right")) if a > t[0] + REST_EDGE_S else 0
        rest[max(begins, k) : np.searchsorted(t, end - REST_EDGE_S, side="right")] = True
        still[k : np.searchsorted(t, end, side="right")] = True
    return rest.astype(np.int8), still


def gnss(aids: Aids, declination: float, t: Array, ahead: bool) -> tuple[Measurements | None, Measurements | None]:
    """Velocity (m/s) and position (m) in local NED axes turned by the declination (rad); sigmas are shapes around one.

    ``t`` (n,) s are the samples' times.
    """
    turn = np.eye(3)
    c, s = math.cos(declination), math.sin(declination)
    turn[:2, :2] = [[c, s], [-s, c]]
    v, p = aids.velocity, aids.position
    velocity = None
    if v is not None and len(v.t) >= MIN_FIXES:
        velocity = Measurements(
            v.t, v.x @ turn.T if not np.isnan(v.x).any() else _turned(v.x, turn), _shape(v.sigma, len(v.t), 1, ahead)
        )
    position = None
    if p is not None and len(p.t) >= MIN_FIXES:
        origin = p.x[0]
        height = p.x[np.isfinite(p.x[:, 2]), 2]
        lat = np.radians(origin[0])
        e2 = FLATTENING * (2.0 - FLATTENING)
        bend = 1.0 - e2 * math.sin(lat) ** 2
        meridian, normal = EQUATOR_M * (1.0 - e2) / bend**1.5, EQUATOR_M / math.sqrt(bend)
        alt = float(height[0]) if len(height) else 0.0
        east = (p.x[:, 1] - origin[1] + 180.0) % 360.0 - 180.0
        local = np.column_stack(
            [
                np.radians(p.x[:, 0] - origin[0]) * (meridian + alt),
                np.radians(east) * (normal + alt) * math.cos(lat),
                alt - p.x[:, 2],
            ]
        )
        position = Measurements(p.t, _turned(local, turn), _shape(p.sigma, len(p.t), 2, ahead))
    return velocity, position


def _turned(x: Array, turn: Array) -> Array:
    """Turn level components; a missing vertical one stays missing alone."""
    out = np.array(x)
    out[:, :2] = x[:, :2] @ turn[:2, :2].T
    return out


def _shape(sigma: Array | None, n: int, columns: int, ahead: bool) -> Array:
    """Return how accuracies (n, columns) change over time, around one: their level is not used."""
    if sigma is None:
        return np.ones((n, columns))
    s = sigma.reshape(n, columns).copy()
    s[~(s > 0.0)] = np.nan
    if ahead:
        with np.errstate(all="ignore"):
            level = np.array(
                [median(s[~np.isnan(s[:, i]), i]) if np.isfinite(s[:, i]).any() else 1.0 for i in range(columns)]
            )
    else:
        known = np.isfinite(s)
        count = np.maximum(np.cumsum(known, axis=0), 1)
        level = np.exp(np.cumsum(np.where(known, np.log(np.where(known, s, 1.0)), 0.0), axis=0) / count)
    shape: Array = np.clip(np.nan_to_num(s / level, nan=1.0), 0.3, 30.0)
    return shape


def _baro(aids: Aids) -> Measurements | None:
    if aids.baro is None or len(aids.baro.t) < MIN_FIXES:
        return None
    t, x, _ = blocks(aids.baro.t, aids.baro.x[:, None], BARO_BLOCK_S)
    return Measurements(t, x[:, 0] - x[0, 0])


def _mag(t: Array, mag: Array, field: Array | None, ahead: bool) -> Measurements | None:
    """Return block means of the field in gauss; None without a field."""
    size = np.sqrt(np.sum(mag * mag, axis=1))
    good = np.isfinite(size) & (size > 0.0)
    if np.count_nonzero(good) < 2:
        return None
    at = t[good]
    known = size[good] if ahead else size[good][at <= at[0] + FIRST_S]
    level = float(median(known))
    wanted = TYPICAL_FIELD_G if field is None else float(np.sqrt(np.sum(field * field)))
    scale = 1e4
    if field is None or abs(level * scale / wanted - 1.0) > MAX_FIELD_BIAS:
        scale = wanted / level
    usual = np.abs(size[good] / level - 1.0) < MAX_FIELD_DEVIATION
    if np.count_nonzero(usual) < 2:
        return None
    at, x, _ = blocks(at[usual], scale * mag[good][usual], MAG_BLOCK_S)
    return Measurements(at, x)


def blocks(t: Array, x: Array, length: float) -> tuple[Array, Array, Array]:
    """Return mean times (k,), means (k, c) and counts (k,) of samples in blocks of ``length`` s."""
    number = np.floor((t - t[0]) / length + 1e-6).astype(np.int64)
    begin = np.flatnonzero(np.r_[True, np.diff(number) > 0])
    count = np.diff(np.append(begin, len(t))).astype(np.float64)
    mean = np.add.reduceat(x, begin, axis=0) / count[:, None]
    return t[0] + np.add.reduceat(t - t[0], begin) / count, mean, count


def _filled(t: Array, acc: Array) -> Array:
    """Interpolate missing specific force (zero vectors)."""
    there = np.any(acc != 0.0, axis=1)
    if there.all() or not there.any():
        return acc
    return np.column_stack([np.interp(t, t[there], acc[there, i]) for i in range(3)])


class RunningMean:
    """Means of samples x (n, k), each over the interval before its time, between any times of their span."""

    def __init__(self, t: Array, x: Array) -> None:
        self.t = t
        self.sum = np.vstack([np.zeros(x.shape[1]), np.cumsum(x[1:] * np.diff(t)[:, None], axis=0)])
        self.first = x[0]

    def mean(self, a: Array, b: Array) -> Array:
        """Means (k, c) between times a and b (k,)."""
        a, b = np.clip(a, self.t[0], self.t[-1]), np.clip(b, self.t[0], self.t[-1])
        length = b - a
        out = np.empty((len(a), self.sum.shape[1]))
        for i in range(out.shape[1]):
            out[:, i] = np.interp(b, self.t, self.sum[:, i]) - np.interp(a, self.t, self.sum[:, i])
        short = length < 1e-9
        out /= np.where(short, 1.0, length)[:, None]
        out[short] = self.first
        return out
