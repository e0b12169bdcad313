"""Small made-up flights for the metric tests: attitudes whose errors are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from attlog.core import rotation
from attlog.flight.model import Firmware, FlightLog
from attlog.metrics.metric import Answer, Case, MetricGroup
from attlog.metrics.step_turning import SummedTurning
from attlog.reference.model import AttitudeErrors, Reference, Scoring, Track
from attlog.segments.model import Segment, Segments

Array = NDArray[np.float64]


def row(t: Array, q: Array, name: str = "filter", **fields: object) -> Track:
    """A replayed row at ``t`` in one run."""
    return Track(name, "replay", t, q, np.zeros(len(t), np.int64), uses_mag=True, **fields)  # type: ignore[arg-type]


def case(
    rows: list[Track],
    segments: list[Segment],
    reference: tuple[Array, Array] | None = None,
    kind: str = "truth",
    scoring_start: float = 0.0,
) -> Case:
    """A case around rows; errors against the reference (t, q) at the reference's times, where there is one."""
    log = FlightLog(Path("made-up.ulg"), "ulog", 0, 0, Firmware("PX4"), "quad")
    t, q = reference if reference is not None else (np.zeros(0), np.zeros((0, 4)))
    zeros = np.zeros(len(t), np.int64)
    ref = Reference(
        kind if len(t) else "none",
        "made-up",
        t,
        q,
        zeros,
        zeros,  # type: ignore[arg-type]
        rate=(len(t) - 1) / (t[-1] - t[0]) if len(t) else 0.0,
        scoring=Scoring(scoring_start),
    )
    if len(t):
        for r in rows:
            r.errors = errors(r, ref)
    return Case(log, Segments(segments), ref, rows)


def errors(r: Track, ref: Reference) -> AttitudeErrors:
    """Errors of a row at the reference's times."""
    inside = (ref.t >= r.t[0]) & (ref.t <= r.t[-1])
    t, q_ref = ref.t[inside], ref.q[inside]
    q_est = rotation.slerp(r.t, r.q, t)
    e = rotation.earth_error(q_est, q_ref)
    return AttitudeErrors(
        t,
        np.degrees(rotation.total_angle(e)),
        np.degrees(rotation.heading_angle(e)),
        np.degrees(rotation.tilt_angle(e)),
        ref.gap_segment[inside],
        ref.segment[inside],
        t >= ref.scoring.start,
        q_est,
        q_ref,
    )


def first_order(x: Array, dt: float, time_constant: float) -> Array:
    """A signal (n,) through a first-order low-pass (exact for a held input)."""
    a = np.exp(-dt / time_constant)
    out = np.empty_like(x)
    state = x[0]
    for i, value in enumerate(x):
        state = a * state + (1 - a) * value
        out[i] = state
    return out


def coloured(rng: np.random.Generator, n: int, dt: float, sigma: float, time_constant: float) -> Array:
    """Stationary Gauss-Markov noise (n,) with standard deviation sigma; white for a time constant of 0."""
    white = rng.standard_normal(n) * sigma
    if time_constant == 0:
        return white
    a = np.exp(-dt / time_constant)
    out = np.empty(n)
    out[0] = white[0]
    drive = white * np.sqrt(1 - a * a)
    for i in range(1, n):
        out[i] = a * out[i - 1] + drive[i]
    return out


# Movements for the step tests: steps, yaw turns, flips, through a second-order vehicle; a filter aided by thrust.

STEP_S = 0.0025


def vehicle(command: Array, omega: float) -> Array:
    """A commanded angle (n,) as a vehicle with natural frequency omega (rad/s) and damping 0.7 follows it."""
    b = (omega * STEP_S) ** 2
    return lfilter([0.0, b], [1.0, 2 * 0.7 * omega * STEP_S - 2.0, 1.0 - 2 * 0.7 * omega * STEP_S + b], command)


def motion(kind: str, seconds: float = 60.0, seed: int = 0) -> tuple[Array, Array]:
    """Times (n,) every 2.5 ms and attitudes (n, 4) of ``steps`` (roll, pitch), ``yaw`` turns or ``flips``."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, STEP_S)
    roll, pitch, yaw = np.zeros((3, len(t)))
    if kind == "steps":
        for k, at in enumerate(np.arange(3.0, seconds - 3.0, 2.0)):
            size = np.radians(rng.uniform(10, 30)) * (1 if k % 2 else -1)
            ((roll, pitch)[(k // 2) % 2])[(t >= at) & (t < at + 1.6)] = size
        return t, rotation.from_euler(vehicle(roll, 12.0), vehicle(pitch, 12.0), np.full(len(t), 0.5))
    if kind == "yaw":
        for at in np.arange(3.0, seconds - 3.0, 3.0):
            yaw[t >= at] += np.radians(rng.uniform(30, 90)) * rng.choice([-1, 1])
        return t, rotation.from_euler(roll + 0.02, pitch - 0.03, vehicle(yaw, 6.0))
    for at in np.arange(3.0, seconds - 3.0, 4.0):
        roll[t >= at] += 2 * np.pi
    return t, rotation.from_euler(vehicle(roll, 4.0), pitch, yaw)


def sampled(t: Array, q: Array, hz: float, delay: float = 0.0, offset: float = 0.0) -> SummedTurning:
    """The motion at ``hz``, ``delay`` s late; ``offset`` shifts the sampling instants."""
    at = np.arange(0.5, t[-1] - 0.5, 1.0 / hz) + offset
    return SummedTurning(at, rotation.slerp(t, q, at - delay), np.zeros(len(at), np.int64))


def aided(t: Array, q: Array, f: Array, kp: float, m: Array | None = None) -> Array:
    """What a complementary filter of gain kp (1/s) makes of the exact turning and of vectors f, m (n, 3).

    Written with scipy's rotations: down is pulled towards -f/|f|, heading towards the field.
    """
    exact = Rotation.from_quat(np.roll(q, -1, axis=1))
    turns = (exact[:-1].inv() * exact[1:]).as_rotvec()
    at = Rotation.from_quat(np.roll(q[0], -1))
    out = [at.as_quat()]
    for k in range(1, len(t)):
        down = at.inv().apply([0.0, 0.0, 1.0])
        correction = np.cross(-f[k] / np.linalg.norm(f[k]), down)
        if m is not None:
            north = at.apply(m[k])
            correction = correction - north[1] / np.hypot(north[0], north[1]) * down
        at = at * Rotation.from_rotvec(turns[k - 1] + kp * correction * (t[k] - t[k - 1]))
        out.append(at.as_quat())
    return np.roll(np.array(out), 1, axis=1)


def ask(groups: tuple[MetricGroup, ...], case: Case, row: Track, window: str) -> dict[str, Answer]:
    """Return the answers of several groups in one."""
    return {name: answer for q in groups for name, answer in q.ask(case, row, window).items()}
