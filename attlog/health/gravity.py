"""The mean force, and an attitude's up, over windows of a phase in which the vehicle stands still."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from attlog.core import earth, rotation
from attlog.core.log_cache import cached_per_log
from attlog.estimators.evidence import mean_directions, still_windows
from attlog.flight.model import Array, Attitude, FlightLog, Imu, Stream
from attlog.health.check import Assessment, Check, HealthCase, graded, not_judged, unknown
from attlog.health.imu import Blocks, dead_axes, still_spans, stream_blocks, usable_imus
from attlog.reference import alignment
from attlog.segments import model
from attlog.segments.model import Segments


def still_directions(imu: Imu, use: NDArray[np.bool_], q: Array) -> tuple[Array, Array]:
    """Mean force (k, 3) in m/s^2 and up (k, 3), a unit vector, in body axes over still windows of samples ``use`` (n,).

    ``q`` (n, 4) is the attitude of the unit at the accelerometer's times, NaN where unknown. The force may have any
    size: an accelerometer with a wrong scale still shows a direction.
    """
    n = min(len(imu.acc.t_best), len(imu.gyro.x))
    t, x = model.select_rising(
        np.where(use, imu.acc.t_best, np.nan)[:n], np.column_stack([imu.gyro.x, imu.acc.x, q])[:n]
    )
    windows = still_windows(t, x[:, :3], x[:, 3:6], near_m_s2=np.inf)
    force, up = mean_directions(windows, t, x[:, 3:6], x[:, 6:])
    known = np.isfinite(force[:, 0]) & np.isfinite(up[:, 0])
    return force[known], up[known]


def degrees_between(a: Array, b: Array) -> Array:
    """Angles (n,) in deg between vectors (n, 3)."""
    angle: Array = np.arctan2(np.sqrt(np.sum(np.cross(a, b) ** 2, axis=1)), np.sum(a * b, axis=1))
    return np.degrees(angle)


# The accelerometer: gravity's size at rest (scale), and its direction against the onboard attitude (mounting).

STANDARD_GRAVITY = 9.80665
TILT_LIMITS_DEG = (3.0, 10.0)
CLIMB_M_S = 8.0
"""Change of vertical speed that a flight may begin or end with: its share of the mean falls with time."""
MEAN_GRAVITY = "mean gravity"
"""What the direction of gravity is about where it is the mean force of a flight, in whose limits no level lies."""
MAX_SAMPLE_STEPS = 5.0
"""A sample stands for so many usual intervals at most: what was lost for longer is not known."""


def gravity_checks(log: FlightLog, segments: Segments) -> list[Check]:
    """Alive, size of gravity, direction of gravity."""
    if not log.imus:
        return []
    imu = log.imus[log.imu or 0]
    found = dead_axes("gravity", imu.acc.x, imu.acc.source)
    if found:
        return found
    rest = segments.mask(imu.acc.t, "rest")
    where = "at rest"
    if rest.sum() < 10:
        rest, where = segments.mask(imu.acc.t, "idle"), "on the ground with motors on"
    return [gravity_check(log, imu, rest, segments, where), direction_check(log, imu, rest, segments, where)]


def expected_gravity(log: FlightLog) -> float:
    """Gravity in m/s^2 at the place of the flight, the standard value where it is unknown."""
    where = alignment.flight_place(log)
    return STANDARD_GRAVITY if where is None else earth.gravity(where[0], where[2])


def gravity_check(log: FlightLog, imu: Imu, rest: NDArray[np.bool_], segments: Segments, where: str) -> Check:
    """Size of gravity in the specific force: its norm at rest (``where``), else its mean in flight."""
    g = expected_gravity(log)
    if rest.sum() < 10:
        return gravity_in_flight(log, imu, segments, g)
    value = float(np.median(np.sqrt(np.sum(imu.acc.x[rest] ** 2, axis=1))))
    verdict = "fault" if not 7.0 <= value <= 13.0 else graded(abs(value - g), 0.3, np.inf)
    text = f"{where[0].upper()}{where[1:]} the accelerometer shows {value:.3f} m/s^2; gravity is {g:.3f}."
    limit = f"ok within 0.3 of {g:.2f}, fault outside 7 to 13"
    scale = [f"Its scale seems to be {value / g:.2f} of what it should be, or it has an offset."]
    return Check("gravity", verdict, text, round(value, 3), "m/s^2", limit, evidence=scale if verdict != "ok" else [])


def gravity_in_flight(log: FlightLog, imu: Imu, segments: Segments, g: float) -> Check:
    """The same without rest in the log."""
    flown = mean_force_in_flight(log, imu, segments)
    if flown is None:
        return not_judged("gravity in flight", "No rest in the log, and no attitude to find gravity in flight.")
    mean, seconds = flown
    value = -float(mean[2])
    good = max(0.5, CLIMB_M_S / seconds)
    verdict = graded(abs(value - g), good, good + 1.0)
    text = f"The mean vertical force over {seconds:.0f} s is {value:.2f} m/s^2; gravity is {g:.2f}."
    limit = f"ok within {good:.1f} of {g:.2f}, fault beyond {good + 1.0:.1f}"
    return Check("gravity in flight", verdict, text, round(value, 3), "m/s^2", limit)


def mean_force_in_flight(log: FlightLog, imu: Imu, segments: Segments) -> tuple[Array, float] | None:
    """Mean specific force (3,) in earth axes by the onboard attitude and the seconds it is over; None without.

    Over seconds the vehicle's own acceleration averages to its change of speed by the
    time, so that gravity is left: manoeuvres do not matter, long records count. Each sample counts for the time that it
    stands for: a logger that thins its records keeps them unevenly.
    """
    onboard = log.onboard_attitude
    if onboard is None or onboard.rate < 5.0:
        return None
    use = segments.mask(imu.acc.t, "airborne")
    use = use if use.sum() >= 50 else np.ones(len(use), bool)
    q = rotation.slerp(onboard.t, imu_attitude(log, onboard), imu.acc.t[use])
    known = rotation.finite_rows(q)
    seconds = float(known.sum()) / imu.acc.rate if imu.acc.rate > 0 else 0.0
    if seconds < 5.0:
        return None
    force = rotation.rotate(q[known], imu.acc.x[use][known])
    return np.average(force, axis=0, weights=_sample_weights(imu.acc.t[use][known])), seconds


def _sample_weights(t: Array) -> Array:
    """The time (n,) s that each sample stands for: half of the way to both of its neighbours."""
    step = np.diff(t)
    half = 0.5 * np.minimum(step, MAX_SAMPLE_STEPS * float(np.median(step)))
    return np.append(half, 0.0) + np.insert(half, 0, 0.0)


def direction_check(log: FlightLog, imu: Imu, rest: NDArray[np.bool_], segments: Segments, where: str) -> Check:
    """Angle between measured gravity and the attitude's down, with the vehicle's trim put back."""
    onboard = log.onboard_attitude
    if onboard is None:
        return not_judged("gravity direction", "There is no onboard attitude to compare with.", "ok up to 3 deg")
    if rest.sum() < 10:
        return direction_in_flight(log, imu, segments)
    limit = "ok up to 3 deg, fault above 10 deg"
    q = rotation.slerp(onboard.t, imu_attitude(log, onboard), imu.acc.t[rest])
    whole = np.full((len(imu.acc.x), 4), np.nan)
    whole[rest] = q
    measured, up = still_directions(imu, rest, whole)
    if not len(measured):
        return not_judged("gravity direction", "The onboard attitude covers no still time on the ground.", limit)
    angle = float(np.median(degrees_between(measured, up)))
    text = f"Measured gravity and {log.onboard} differ by {angle:.3g} deg {where}."
    hint = mounting_hint(measured, up) if angle > TILT_LIMITS_DEG[1] else []
    verdict = graded(angle, *TILT_LIMITS_DEG)
    return Check("gravity direction", verdict, text, round(angle, 3), "deg", limit, evidence=hint)


def direction_in_flight(log: FlightLog, imu: Imu, segments: Segments) -> Check:
    """The same from the mean specific force in flight, which holds less tightly."""
    limit = "ok up to 10 deg in flight, fault above 30 deg"
    flown = mean_force_in_flight(log, imu, segments)
    if flown is None:
        return not_judged("gravity direction", "No rest in the log, and too little attitude in flight.", limit)
    mean, seconds = flown
    angle = float(np.degrees(np.arctan2(np.hypot(mean[0], mean[1]), -mean[2])))
    text = f"Mean gravity over {seconds:.0f} s and {log.onboard} differ by {angle:.1f} deg."
    verdict = graded(angle, 10.0, 30.0)
    return Check("gravity direction", verdict, text, round(angle, 2), "deg", limit, about=MEAN_GRAVITY)


def imu_attitude(log: FlightLog, attitude: Attitude) -> Array:
    """The attitude of the IMU (n, 4): the logged one with the vehicle's trim put back where it was taken out."""
    turned = log.parameters.trim if attitude.has_trim else None
    return attitude.q if turned is None else rotation.multiply(attitude.q, rotation.from_rotvec(turned))


def mounting_hint(measured: Array, up: Array) -> list[str]:
    """A sentence with the quarter turn that would explain the difference, none if none does."""
    for roll, pitch in product((0, 90, 180, 270), (0, 90, 270)):
        turn = rotation.from_euler(np.radians(roll), np.radians(pitch), 0.0)
        if (roll or pitch) and np.median(degrees_between(rotation.rotate(turn, measured), up)) < TILT_LIMITS_DEG[1]:
            name = " and ".join(f"{n} {a} deg" for n, a in (("roll", roll), ("pitch", pitch)) if a)
            return [f"A sensor mounted with {name} would show this."]
    return []


# Does the onboard estimator take so much off the accelerometer that its attitude is tilted by it?

G = 9.80665
ACC_BIAS_TILT_DEG = (1.0, 3.0)
"""A horizontal bias of 0.17 m/s^2 tilts the level by 1 deg, 0.5 m/s^2 by 3 deg."""
MAX_LEFT_SHARE = 0.5
"""It explains a tilt difference at rest where it leaves less than half of it."""


def onboard_acc_bias_check(log: FlightLog, segments: Segments) -> list[Check]:
    """The tilt that the estimated accelerometer bias makes, and whether gravity at rest confirms or refutes it."""
    stream = log.estimator.acc_bias
    if stream is None:
        return []
    bias = np.median(stream.x, axis=0)
    tilt = float(np.degrees(np.arctan2(np.hypot(bias[0], bias[1]), G)))
    worst = "xy"[int(np.argmax(np.abs(bias[:2])))]
    size = float(bias["xy".index(worst)])
    least, most = ACC_BIAS_TILT_DEG
    limit = f"ok up to {least:.0f} deg of tilt, where gravity at rest does not show it up to {most:.0f}; fault above"
    text = (
        f"The onboard estimator subtracts {size:+.2f} m/s^2 from the accelerometer's {worst}: {tilt:.1f} deg of tilt."
    )
    both = tilt_with_and_without_bias(log, segments, bias) if tilt > ACC_BIAS_TILT_DEG[0] else None
    seen = []
    if both is not None and both[1] < MAX_LEFT_SHARE * both[0]:
        plain, corrected = both
        seen = [f"It explains {plain - corrected:.1f} of {plain:.1f} deg between {log.onboard} and gravity at rest."]
    verdict = "fault" if tilt > ACC_BIAS_TILT_DEG[1] else "warning" if seen else "ok"
    return [Check("accelerometer bias", verdict, text, round(size, 3), "m/s^2", limit, evidence=seen)]


def tilt_with_and_without_bias(log: FlightLog, segments: Segments, bias: Array) -> tuple[float, float] | None:
    """Median angle in deg at rest between the attitude's up and the force: as measured, and without the bias."""
    imu, onboard = log.replay_imu, log.onboard_attitude
    if imu is None or onboard is None:
        return None
    rest = segments.mask(imu.acc.t, "rest")
    q = rotation.slerp(onboard.t, imu_attitude(log, onboard), imu.acc.t[rest])
    known = rotation.finite_rows(q)
    if known.sum() < 10:
        return None
    up = rotation.rotate_inverse(q[known], np.array([0.0, 0.0, -1.0]))
    found = []
    for force in (imu.acc.x[rest][known], imu.acc.x[rest][known] - bias):
        found.append(float(np.median(degrees_between(force / np.sqrt(np.sum(force**2, axis=1, keepdims=True)), up))))
    return found[0], found[1]


# Does each accelerometer show gravity's size while the vehicle stands still?
#
# At one rest only the size is known: an offset along the vertical and a wrong scale look alike.

REST_QUESTION = "accelerometer_rest"
GRAVITY_OFF_M_S2, GRAVITY_FAR_M_S2 = 0.3, 1.0
"""The first as the check of gravity's size; beyond the second an offset fitted in flight is not exact either."""
GRAVITY_SIGMAS, GRAVITY_FLOOR_M_S2 = 4.0, 0.01
"""The model of gravity and a level that is not exact."""
REST_LIMIT = (
    f"ok within {GRAVITY_OFF_M_S2} m/s^2 or {GRAVITY_SIGMAS:.0f} sigma of gravity, fault beyond {GRAVITY_FAR_M_S2:.0f}"
)
REST_SOURCE = "gravity at the place of the flight; 3 % of it tilts nothing but spoils heights"


def gravity_at_rest(case: HealthCase) -> list[Assessment]:
    """One assessment for each accelerometer; one ``unknown`` where the vehicle never stands still."""
    units = usable_imus(case)
    if not units:
        return []
    sizes = {imu.acc.source: size_at_rest(case, imu) for imu in units}
    found = [
        _gravity_assessment(case, imu, size)
        for imu in units
        if (size := sizes[imu.acc.source]) is not None and _is_certain(size)
    ]
    why = "The vehicle never stands still on the ground in this log, or shakes too much."
    return found or [unknown(units[0].acc.source, REST_QUESTION, why, REST_LIMIT, REST_SOURCE)]


def _is_certain(size: Blocks) -> bool:
    """Whether it is known as well as an error of it counts."""
    return 1.96 * float(size.sigma(GRAVITY_FLOOR_M_S2)[0]) <= GRAVITY_OFF_M_S2


@cached_per_log
def size_at_rest(case: HealthCase, imu: Imu) -> Blocks | None:
    """Size of the specific force (b, 1) in m/s^2 over blocks of still time on the ground; None without any."""
    spans = [] if case.segments is None else still_spans(case.segments)[0]
    acc = imu.acc
    size = Stream(acc.t, rotation.length(acc.x)[:, None], acc.unit, "", acc.source, t_sample=acc.t_sample)
    return stream_blocks(size, spans)


def _gravity_assessment(case: HealthCase, imu: Imu, found: Blocks) -> Assessment:
    assert case.segments is not None
    where, g = still_spans(case.segments)[1], expected_gravity(case.log)
    size, sigma = float(found.middle[0]), float(found.sigma(GRAVITY_FLOOR_M_S2)[0])
    error = size - g
    off_from = max(GRAVITY_OFF_M_S2, GRAVITY_SIGMAS * sigma)
    verdict = graded(abs(error), off_from, max(GRAVITY_FAR_M_S2, off_from))
    text = f"{imu.acc.source} shows {size:.2f} ± {1.96 * sigma:.2f} m/s^2 {where}; gravity is {g:.2f}."
    off = verdict != "ok"
    return Assessment(
        imu.acc.source,
        REST_QUESTION,
        verdict,
        text,
        value=round(size, 3),
        unit="m/s^2",
        ci95=(round(size - 1.96 * sigma, 3), round(size + 1.96 * sigma, 3)),
        n=found.samples,
        seconds=round(found.seconds, 1),
        threshold=REST_LIMIT,
        source=REST_SOURCE,
        why_no_setting=_scale_or_offset(size / g) if off else "",
        action=case.log.remedies.get("accelerometer", "") if off else "",
    )


def _scale_or_offset(scale: float) -> str:
    also = f"Scale {scale:.3f} or an offset: one position cannot show which." if np.isfinite(scale) else ""
    return f"{also} Log six positions, or a flight with GNSS.".strip()
