"""Tests whether a row follows motion and is corrected by gravity."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog import estimators
from attlog.core import rotation
from attlog.core.errors import AttlogError
from attlog.core.sorting import median
from attlog.estimators.samples import Sampling
from attlog.metrics import step_fit, step_turning
from attlog.metrics.metric import Answer, Case, per_object, per_row
from attlog.metrics.windows import imu_of, within
from attlog.reference.model import Track
from attlog.segments import model

# Filters run on a vehicle at rest: response to a turn, and correction by gravity.
#
# On the log's own rest, or on synthetic samples at the log's rate.

GRAVITY_M_S2 = 9.81  # of synthetic samples
# Synthetic field to north and down; filters use its direction only.
MADE_FIELD = (0.2, 0.0, 0.4)
# Limits of the rate of synthetic samples, otherwise the log's.
MADE_RATE_HZ = (20.0, 200.0)
MIN_STILL_SAMPLES = 20  # smallest number of samples of a rest


class StillSamples(NamedTuple):
    """Samples at rest: ``t`` (n,) s, ``gyro`` (n, 3) rad/s, ``acc`` (n, 3) m/s^2, ``mag`` (n, 3) or None."""

    t: Array
    gyro: Array
    acc: Array
    mag: Array | None
    sampling: Sampling


def level_samples(case: Case, row: Track, seconds: float) -> StillSamples | None:
    """Return noise-free samples of a level vehicle at rest."""
    imu = imu_of(case, row)
    if row.kind != "replay" or imu is None or len(imu.gyro.t) < 2:
        return None
    step = float(np.clip(median(np.diff(imu.gyro.t)), 1.0 / MADE_RATE_HZ[1], 1.0 / MADE_RATE_HZ[0]))
    t = np.arange(0.0, seconds, step)
    acc, mag = (np.tile(x, (len(t), 1)) for x in ((0.0, 0.0, -GRAVITY_M_S2), MADE_FIELD))
    return StillSamples(t, np.zeros((len(t), 3)), acc, mag if row.uses_mag else None, "interval")


def rest_samples(case: Case, row: Track, shortest: float, longest: float) -> StillSamples | None:
    """Return the end of the log's longest rest, at most ``longest`` s."""
    imu = imu_of(case, row)
    rest = max(case.segments.of("rest"), key=lambda s: s.seconds, default=None)
    if row.kind != "replay" or rest is None or imu is None:
        return None
    segments = within(imu.gyro.t, (max(rest.t0, rest.t1 - longest), rest.t1))
    own = max(segments, key=lambda p: p.stop - p.start, default=slice(0, 0))
    t = imu.gyro.t[own]
    if len(t) < MIN_STILL_SAMPLES or t[-1] - t[0] < shortest:
        return None
    mag = None
    if row.uses_mag and case.log.mag is not None:
        field = case.log.mags[case.log.mag].field
        near = (field.t_best >= t[0]) & (field.t_best <= t[-1])
        mag = estimators.place(t, field.t_best[near], field.x[near])
    return StillSamples(t, case.gyro_of(imu)[own], imu.acc.x[own], mag, imu.gyro.sampling)


def final_attitude(row: Track, still: StillSamples, gyro: Array, acc: Array, mag: Array | None) -> Array:
    """Return the filter's final attitude (4,); AttlogError if it cannot run."""
    estimator = estimators.get(row.estimator)
    stands = estimators.Measurements(still.t[:1], np.zeros((1, 3))) if "gnss" in estimator.needs else None
    aids = estimators.Aids(velocity=stands)
    found = estimators.estimate(
        estimator, still.t, gyro, acc, mag, sampling=still.sampling, aids=aids, check_units=False, **row.parameters
    )
    return rotation.normalize(found.q[-1])


# Rate and length of the pulse: docs/metrics.md, Noise.
RATE_DPS, PULSE_S = 20.0, 1.0
# Shortest and longest time at rest with the pulse.
SETTLE_S, LONGEST_S = 1.0, 8.0


def add_pulse(t: Array, vectors: Array, axis: int) -> tuple[Array, Array]:
    """Return a rotation pulse in the last second of ``t``.

    Rates (n, 3) rad/s, and earth-fixed ``vectors`` (n, 3) in the turning body axes.
    """
    on = t > t[-1] - PULSE_S
    rate = np.zeros((len(t), 3))
    rate[on, axis] = np.radians(RATE_DPS)
    turned = np.zeros((len(t), 3))
    turned[1:, axis] = np.cumsum(rate[1:, axis] * np.diff(t))
    return rate, rotation.rotate_inverse(rotation.from_rotvec(turned), vectors)


@per_row
def pulse_gain(case: Case, row: Track, axis: int) -> float | None:
    """Return the gain of a pulse about body x, y or z.

    At the end of the log's longest rest, else on synthetic samples. Real filters have 1.00, those with an accelerometer
    alone 0.2 to 0.7, a frozen one 0. None without a replay.
    """
    probe = _probe(case, row)
    if probe is None:
        return None
    rest, before = probe
    rate, acc = add_pulse(rest.t, rest.acc, axis)
    mag = None if rest.mag is None else add_pulse(rest.t, rest.mag, axis)[1]
    try:
        after = final_attitude(row, rest, rest.gyro + rate, acc, mag)
    except AttlogError:
        return None
    turn = rotation.to_rotvec(rotation.multiply(rotation.conjugate(before), after))[axis]
    gain = float(turn / np.sum(rate[1:, axis] * np.diff(rest.t)))
    return gain if np.isfinite(gain) else None


@per_row
def _probe(case: Case, row: Track) -> tuple[StillSamples, Array] | None:
    """Return samples at rest, and the filter's attitude (4,) after them; None if it cannot run again."""
    rest = rest_samples(case, row, SETTLE_S + PULSE_S, LONGEST_S) or level_samples(case, row, LONGEST_S)
    if rest is None:
        return None
    try:
        return rest, final_attitude(row, rest, rest.gyro, rest.acc, rest.mag)
    except AttlogError:
        return None  # the row stays unranked


STILL_S, TILT_PULSE_S, AFTER_S = 20.0, 0.5, 10.0  # settling, tilt by 10 deg, and recovery
# Largest share of a corrected filter. Integrated gyro has 1.00, ``mekf``, which may explain the tilt by an
# accelerometer bias, 0.33 to 0.50 (6 logs), all others 0.00 to 0.32.
MAX_LEFT = 0.8
UNCORRECTED = "it is not corrected by gravity"


@per_row
def tilt_left(case: Case, row: Track) -> float | None:
    """Return the share of a false tilt left after 10 s.

    Synthetic samples of a level vehicle: 20 s at rest, then 20 deg/s about x for 0.5 s in the gyro alone. The
    accelerometer stays level, so that a filter corrected by it returns. None without a causal replay.
    """
    rest = level_samples(case, row, STILL_S + TILT_PULSE_S + AFTER_S) if row.causal else None
    if rest is None:
        return None
    gyro = rest.gyro.copy()
    pulse = (rest.t > STILL_S) & (rest.t <= STILL_S + TILT_PULSE_S)
    gyro[pulse, 0] = np.radians(RATE_DPS)
    try:
        after = final_attitude(row, rest, gyro, rest.acc, rest.mag)
    except AttlogError:
        return None
    tilt = np.radians(RATE_DPS) * float(np.sum(np.diff(rest.t)[pulse[1:]]))
    left = float(rotation.tilt_angle(after)) / tilt
    return left if np.isfinite(left) else None


def why_uncorrected(case: Case, row: Track) -> str | None:
    """Return a reason if gravity does not correct a row, else None."""
    left = tilt_left(case, row)
    return UNCORRECTED if left is not None and left > MAX_LEFT else None


Array = NDArray[np.float64]

MIN_GAIN, MAX_GAIN = 0.8, 1.2
MOVING_DPS = 5.0  # slower turns are mostly noise
# See docs/metrics.md, Noise.
MIN_MOTION_SAMPLES = 20


def _gains_of(t: Array, q_est: Array, ref: Array, segment: NDArray[np.int64]) -> Array:
    """Return gains (4,) of an estimate's rotation on the reference's.

    About body x, y, z and all axes together; ``ref`` (n - 1, 3) in rad between samples. Regression through the origin
    where the reference turns faster than 5 deg/s, without steps between segments (gaps, resets). NaN for fewer than 20
    such samples.
    """
    dt = np.diff(t)
    limit = np.radians(MOVING_DPS) * dt
    fast = np.abs(ref[:, 0]) > limit
    for column in ref.T[1:]:
        fast |= np.abs(column) > limit
    at = np.flatnonzero(fast & (segment[1:] == segment[:-1]) & (dt > 0))
    est, ref = rotation.relative_rotvecs(q_est[at], q_est[at + 1]), ref[at]
    known = rotation.finite_rows(est) & rotation.finite_rows(ref)
    est, ref, limit = model.select_good(known, est, ref, limit[at])
    moving: NDArray[np.bool_] = np.asarray(np.abs(ref) > limit[:, None])
    gains, together = np.full(4, np.nan), np.ones(len(est), bool)
    for place, use, part in [*((k, moving[:, k], slice(k, k + 1)) for k in range(3)), (3, together, slice(None))]:
        if np.count_nonzero(use) >= MIN_MOTION_SAMPLES:
            moved = np.where(use[:, None], ref[:, part], 0.0)
            gains[place] = float(np.sum(est[:, part] * moved)) / float(np.sum(moved * moved))
    return gains


@per_object
def _turns(case: Case, q: Array) -> Array:
    """Return rotations (n - 1, 3) rad between samples of an attitude."""
    return rotation.increments(q)


@per_row
def why_not_following(case: Case, row: Track, axis: str) -> str | None:
    """Return why a row is not known to follow motion, else None.

    ``axis``: roll, pitch or heading. By its steps, by regression, or by a pulse at rest: one gain of 0.8 to 1.2
    suffices. Acceleration lowers gains of real filters in steps (to 0.75); the pulse then shows that they are not
    frozen.
    """
    found: list[str] = []
    for gain, how in _gains(case, row, ("roll", "pitch", "heading").index(axis)):
        if MIN_GAIN <= gain <= MAX_GAIN:
            return None
        found.append(f"{gain:.2f} {how}")
    if not found:
        return "did not move: nothing shows that this row follows motion"
    return f"does not follow motion: gain {', '.join(found)} ({MIN_GAIN} to {MAX_GAIN} shows that it does)"


def _gains(case: Case, row: Track, axis: int) -> Iterator[tuple[float, str]]:
    """Yield the known gains of a row about one axis, best first."""
    step = step_fit.fits(case, row, "all").get(step_turning.AXES[axis])
    if step is not None and len(step.events) >= step_fit.MIN_EVENTS:
        yield step.plain_gain, f"in {len(step.events)} steps"
    regression = _regression(case, row)
    if np.isfinite(regression[axis]):
        yield float(regression[axis]), "by regression on the reference's rate"
    probed = pulse_gain(case, row, axis)
    if probed is not None:
        yield probed, "in a probe at rest"


def unrank_frozen(case: Case, row: Track, axis: str, answer: Answer) -> Answer:
    """Return the answer, not ranked if the row may be frozen."""
    if answer.value is not None and answer.ranked:
        why = why_not_following(case, row, axis)
        answer.ranked, answer.reason = why is None, why or answer.reason
    return answer


@per_row
def _regression(case: Case, row: Track) -> Array:
    if row.errors is None or len(row.errors.t) < 2:
        return np.full(4, np.nan)
    e = row.errors
    return _gains_of(e.t, e.q_est, _turns(case, e.q_ref), e.segment)
