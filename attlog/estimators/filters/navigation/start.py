"""Where a run starts: attitude, velocity and biases, and how sure of them.

- *static* (the first 2 s mostly rest): gyro bias is the mean rate of rest; down from the mean accelerometer, heading
  from the mean field.
- *quiet* (0.6 s that hardly turn and weigh g, GNSS slower than 1 m/s): the same without a bias.
- *in motion*: the attitude that best turns what accelerometer and gyro feel between fixes of the first 8 s into what
  GNSS says, and the field into the earth's (Wahba's problem by SVD: Markley1988); without GNSS the mean of 2 s in a
  frame turned by the gyro.

The covariance ties attitude to accelerometer bias, hard and soft iron and earth field from the start by one update at
this attitude: heading is born correlated with what it came from.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np

from attlog.core import rotation
from attlog.estimators.filters.navigation.inputs import Inputs, NoiseLevels, RunningMean
from attlog.estimators.filters.navigation.model import E, N
from attlog.estimators.filters.navigation.turns import chain
from attlog.estimators.interface import Array

STATIC_S, QUIET_S, MOTION_S, TURNED_S = 2.0, 0.6, 8.0, 2.0
QUIET_RAD_S, QUIET_M_S2, QUIET_M_S = np.deg2rad(3.0), 0.4, 1.0
PAIR_S = (0.9, 2.1)
MIN_PAIRS = 3
NEAR_FIX_S = 2.0
FIELD_WEIGHT = 20.0
ACC_NOISE = {"static": 0.05, "quiet": 0.5, "motion": 0.7}
MAG_NOISE_G = {"static": 0.003, "quiet": 0.010, "motion": 0.030}
FIELD_UNKNOWN, DECLINATION_UNKNOWN = 0.1, np.deg2rad(15.0)
How = Literal["static", "quiet", "motion"]


@dataclass(slots=True)
class StartState:
    """``q`` (4,), ``x`` (39,), ``P`` (39, 39), and by which way they were found."""

    q: Array
    x: Array
    P: Array
    how: How

    def copy(self) -> StartState:
        """Return a copy with its own arrays."""
        return StartState(self.q.copy(), self.x.copy(), self.P.copy(), self.how)

    def turned(self, heading: float) -> StartState:
        """Return the start turned by a heading in rad."""
        return StartState(rotation.turn_about_down(self.q, heading), self.x.copy(), self.P.copy(), self.how)


def start(inputs: Inputs, tuned: NoiseLevels, known: StartState | None = None) -> StartState:
    """Return the state before the first sample; ``known`` gives attitude, velocity, position of a pass before."""
    x = np.zeros(N)
    how, q, bias = _attitude(inputs, tuned)
    x[E.bg : E.bg + 3] = bias
    velocity, position = _first_fix(inputs)
    if how != "static" and velocity is not None:
        x[E.v : E.v + 3] = velocity
    if position is not None:
        x[E.pos : E.pos + 3] = position
    x[E.earth : E.earth + 3] = _field(inputs, q)
    if known is not None:
        q = known.q.copy()
        x[E.v : E.v + 3], x[E.pos : E.pos + 3] = known.x[E.v : E.v + 3], known.x[E.pos : E.pos + 3]
    return StartState(q, x, covariance(inputs, tuned, q, x, how, position is not None), how)


def _attitude(inputs: Inputs, tuned: NoiseLevels) -> tuple[How, Array, Array]:
    """Return how the attitude was found, q (4,) and the gyro bias (3,)."""
    t, zero = inputs.sensed_at, np.zeros(3)
    early = t <= t[0] + STATIC_S
    if t[-1] - t[0] > QUIET_S and np.mean(inputs.still[early]) > 0.5:
        still = early & inputs.still
        return "static", _level(inputs, still), np.mean(inputs.gyr[still], axis=0)
    first = t <= t[0] + QUIET_S
    gyr, acc = np.mean(inputs.gyr[first], axis=0), np.mean(inputs.acc[first], axis=0)
    quiet = np.sqrt(np.sum(gyr**2)) < QUIET_RAD_S
    quiet &= abs(np.sqrt(np.sum(acc**2)) - inputs.gravity) < QUIET_M_S2
    velocity = _first_fix(inputs)[0]
    quiet &= velocity is None or float(np.sqrt(np.sum(velocity**2))) < QUIET_M_S
    if quiet:
        return "quiet", _level(inputs, first), zero
    return "motion", _in_motion(inputs, tuned), zero


def _first_fix(inputs: Inputs) -> tuple[Array | None, Array | None]:
    """Return velocity and position (3,) of the first fix, None if there is none within 2 s."""
    found = []
    for m in (inputs.velocity, inputs.position):
        near = m is not None and m.t[0] <= inputs.t[0] + NEAR_FIX_S
        found.append(np.nan_to_num(m.x[0]) if m is not None and near else None)
    return found[0], found[1]


def _level(inputs: Inputs, samples: Array) -> Array:
    """Level by the mean accelerometer of some samples, heading by the field of the same time."""
    force = np.mean(inputs.acc[samples], axis=0)
    t = inputs.sensed_at[samples]
    field = None
    if inputs.mag is not None:
        near = inputs.mag.t <= max(t[-1], inputs.mag.t[0] + QUIET_S)
        field = np.mean(inputs.mag.x[near], axis=0)
    return from_vectors(force, field, inputs.field)


def from_vectors(force: Array, field: Array | None, earth_field: Array | None) -> Array:
    """Return the attitude (4,), body to earth, by ``force`` (3,) m/s^2 and ``field`` (3,).

    The field lies over ``earth_field``. Identity without a force.
    """
    size = float(np.sqrt(np.sum(force**2)))
    if not size > 1e-6:
        return np.array([1.0, 0.0, 0.0, 0.0])
    down = -force / size
    side = np.eye(3)[int(np.argmin(np.abs(down)))] if field is None else field
    east = np.cross(down, side)
    if float(np.sqrt(np.sum(east**2))) < 1e-9:
        east = np.cross(down, np.eye(3)[int(np.argmin(np.abs(down)))])
    east /= np.sqrt(np.sum(east**2))
    north = np.cross(east, down)
    q = rotation.from_matrix(np.array([north, east, down]))
    if field is None:
        return rotation.turn_about_down(q, -float(rotation.to_euler(q)[2]))
    return q if earth_field is None else rotation.turn_about_down(q, math.atan2(earth_field[1], earth_field[0]))


def _in_motion(inputs: Inputs, tuned: NoiseLevels) -> Array:
    """Return the attitude at the first sample from the first seconds of motion."""
    t = inputs.sensed_at
    n = int(np.searchsorted(t, t[0] + MOTION_S))
    n = min(max(n, 2), len(t))
    if n < 2:
        return _level(inputs, np.ones(len(t), bool))
    q = turned_by_gyro(inputs.gyr[:n], inputs.dt[:n])
    force = RunningMean(t[:n], rotation.rotate(q, inputs.acc[:n]))
    earth_side, body_side = _pairs(inputs, tuned, force, float(t[n - 1]))
    pairs = len(earth_side)
    fields: Array = np.zeros((0, 3))
    if inputs.mag is not None:
        m = inputs.mag.between(float(t[0]), float(t[n - 1]))
        if m is not None:
            k = np.clip(np.searchsorted(t[:n], m.t - tuned.mag_delay), 0, n - 1)
            fields = rotation.rotate(q[k], m.x)
    if pairs < MIN_PAIRS:
        b = min(float(t[0]) + TURNED_S, float(t[n - 1]))
        mean = force.mean(np.array([t[0]]), np.array([b]))[0]
        return from_vectors(mean, np.mean(fields, axis=0) if len(fields) else None, inputs.field)
    B = np.einsum("ki,kj->ij", earth_side, body_side)
    if len(fields):
        target = inputs.field
        if target is None:
            first = rotation.rotate(rotation.from_matrix(rotation.nearest_rotation(B)), np.mean(fields, axis=0))
            target = np.array([math.hypot(first[0], first[1]), 0.0, first[2]])
        B += FIELD_WEIGHT * pairs / len(fields) * np.outer(target, np.sum(fields, axis=0))
    return rotation.from_matrix(rotation.nearest_rotation(B))


def _pairs(inputs: Inputs, tuned: NoiseLevels, force: RunningMean, end: float) -> tuple[Array, Array]:
    """Return velocity changes less gravity between fixes 1 to 2 s apart, in earth axes and by force."""
    v = inputs.velocity
    none = np.zeros((0, 3))
    if v is None:
        return none, none
    when = v.t - tuned.gnss_delay
    use = np.flatnonzero((when >= force.t[0]) & (when <= end) & np.isfinite(v.x).all(axis=1))
    chosen = [(i, j) for i, j in combinations(use.tolist(), 2) if PAIR_S[0] <= when[j] - when[i] <= PAIR_S[1]]
    if not chosen:
        return none, none
    i, j = np.array(chosen).T
    span = (when[j] - when[i])[:, None]
    return v.x[j] - v.x[i] - span * np.array([0.0, 0.0, inputs.gravity]), span * force.mean(when[i], when[j])


def turned_by_gyro(gyr: Array, dt: Array) -> Array:
    """Return attitudes (n, 4) relative to the first sample, from the gyro alone."""
    return rotation.normalize(chained(gyr * dt[:, None]))


def chained(turns: Array) -> Array:
    """Chain the turns (n, 3), rotation vectors, to attitudes (n, 4); the first is taken as none."""
    q = np.empty((len(turns), 4))
    chain(rotation.from_rotvec(turns), q)
    return q


def _field(inputs: Inputs, q: Array) -> Array:
    """Return the earth's field (3,) in G: the model's, or the measured one at the start attitude."""
    if inputs.field is not None:
        return np.array(inputs.field)
    if inputs.mag is None:
        return np.zeros(3)
    seen = rotation.rotate(q, np.mean(inputs.mag.x[: max(1, min(len(inputs.mag.t), 25))], axis=0))
    return np.array([math.hypot(seen[0], seen[1]), 0.0, seen[2]])


def covariance(inputs: Inputs, tuned: NoiseLevels, q: Array, x: Array, how: How, near_fix: bool) -> Array:
    """Return P (39, 39): the priors, tied by accelerometer and field at this attitude."""
    prior = tuned.prior
    sd = np.zeros(N)
    gnss, mag = inputs.velocity is not None or inputs.position is not None, inputs.mag is not None
    sd[E.phi : E.phi + 3] = np.deg2rad(30.0)
    sd[E.phi + 2] = np.deg2rad(30.0 if mag else 60.0)
    sd[E.v : E.v + 3] = 0.05 if how == "static" else 1.0 if near_fix or not gnss else 5.0
    sd[E.pos : E.pos + 3] = 5.0 if near_fix or not gnss else 20.0
    sd[E.bg : E.bg + 3] = prior.gyro_bias_rest if how == "static" else prior.gyro_bias
    sd[E.ba : E.ba + 3] = prior.acc_bias
    sd[E.scale : E.scale + 3] = prior.scale
    if gnss:
        sd[E.arm : E.arm + 3], sd[E.gnss_delay] = prior.arm, prior.gnss_delay
        sd[E.wander : E.wander + 3] = prior.wander if inputs.position is not None else 0.0
    if inputs.baro is not None:
        sd[E.baro] = prior.baro
    if mag:
        sd[E.hard : E.hard + 3], sd[E.soft : E.soft + 6], sd[E.mag_delay] = prior.hard, prior.soft, prior.mag_delay
    P = np.diag(sd**2)
    if mag:
        P[E.earth : E.earth + 3, E.earth : E.earth + 3] = _field_spread(inputs, tuned, x[E.earth : E.earth + 3], gnss)
    R = rotation.to_matrix(q)
    H = np.zeros((3, N))
    H[:, E.phi : E.phi + 3] = R.T @ _cross(np.array([0.0, 0.0, -inputs.gravity]))
    H[:, E.ba : E.ba + 3] = np.eye(3)
    P = _updated(P, H, ACC_NOISE[how])
    return _updated(P, field_matrix(R, x), MAG_NOISE_G[how]) if mag else P


def _field_spread(inputs: Inputs, tuned: NoiseLevels, field: Array, gnss: bool) -> Array:
    """Return the covariance (3, 3) of the earth field: its size and dip along, its direction across."""
    level = math.hypot(field[0], field[1])
    known = inputs.field is not None
    along = (tuned.prior.field_size if known else FIELD_UNKNOWN) * float(np.sqrt(np.sum(field**2)))
    across = math.hypot(tuned.prior.declination, DECLINATION_UNKNOWN if gnss and not known else 0.0) * level
    c, s = (field[0] / level, field[1] / level) if level > 0 else (1.0, 0.0)
    axes = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    spread: Array = axes @ np.diag([along**2, across**2, along**2]) @ axes.T
    return spread


def field_matrix(R: Array, x: Array) -> Array:
    """Return the rows (3, 39) of a field sample at attitude R, without rotation."""
    S = x[E.soft : E.soft + 6]
    soft = np.eye(3) + np.array([[S[0], S[3], S[4]], [S[3], S[1], S[5]], [S[4], S[5], S[2]]])
    M = x[E.earth : E.earth + 3]
    m = R.T @ M
    C = soft @ R.T
    H = np.zeros((3, N))
    H[:, E.phi : E.phi + 3] = C @ _cross(M)
    H[:, E.earth : E.earth + 3] = C
    H[:, E.hard : E.hard + 3] = np.eye(3)
    H[:, E.soft : E.soft + 6] = [
        [m[0], 0.0, 0.0, m[1], m[2], 0.0],
        [0.0, m[1], 0.0, m[0], 0.0, m[2]],
        [0.0, 0.0, m[2], 0.0, m[0], m[1]],
    ]
    return H


def _updated(P: Array, H: Array, noise: float) -> Array:
    """Return P after one update that leaves the state."""
    S = H @ P @ H.T + noise**2 * np.eye(3)
    K = np.linalg.solve(S, H @ P).T
    P = P - K @ S @ K.T
    symmetric: Array = 0.5 * (P + P.T)
    return symmetric


def _cross(u: Array) -> Array:
    """Return [u] with [u] x = u x x."""
    return np.array([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])
