"""Checks of a reference against gravity and against agreeing filters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation, spans
from attlog.core.errors import AttlogError
from attlog.core.kinematics import earth_force, known_earth_force, tilt_deg
from attlog.core.log_cache import cached_per_log
from attlog.core.sorting import median, nanmedian, unique
from attlog.core.spans import Span
from attlog.core.spans import between as time_slice
from attlog.estimators.evidence import still_windows, tilt_residual, within
from attlog.flight.model import Attitude, FlightLog, Gnss, Imu
from attlog.reference import alignment, scoring, sensor_faults
from attlog.reference.model import SMOOTHER, AlignmentStep, Reference, Track
from attlog.segments import Segments, increments, model
from attlog.segments.model import interpolate_attitudes

Array = NDArray[np.float64]

# Tilt to gravity at rest above which the reference or the accelerometer's axes are wrong.
MAX_GRAVITY_TILT_DEG = 10.0
# Or: share of the quiet time, and number of segments, with such a tilt where the force has the size of gravity.
MIN_WRONG_SHARE, MIN_WRONG_SEGMENTS = 0.2, 2
GRAVITY_M_S2, GRAVITY_TOLERANCE_M_S2 = 9.80665, 0.5
# Time after its start in which an onboard attitude may be wrong.
ALIGNED_S = 15.0
# Longest time over which the gyro shows whether the reference turned as it, and step of its integration. Share of the
# tilt up to which both agree; a biased gyro that misled the reference leaves the whole tilt.
MAX_GYRO_S, GYRO_STEP_S, GYRO_SHARE = 200.0, 0.1, 0.4
# Accelerometer samples of one segment that are enough for its mean.
MAX_FORCE_SAMPLES = 2000
QUIET_WORDS = {"rest": "at rest", "idle": "on the ground with motors on", "hover": "in hover"}


class QuietSegment(NamedTuple):
    """Comparison of a reference with the mean force of a quiet segment.

    ``tilt``: angle between its down and the force, deg; ``force``: size, m/s^2.
    """

    kind: str
    t0: float
    seconds: float
    tilt: float
    force: float


def gravity_check(reference: Reference, imu: Imu | None, segments: Segments) -> tuple[str, list[AlignmentStep]]:
    """Return how gravity contradicts the reference (or ""), with the step.

    By the median tilt at rest, else idling, else in hover, where the mean specific force is gravity too; and by single
    quiet segments whose force has the size of gravity. Segments to which gyro and reference turned alike from a sound
    one are left out: the accelerometer changed between. A smoother follows this gyro and keeps them.
    """
    if imu is None:
        return "", []
    force = model.select_rising(imu.acc.t_best, imu.acc.x)
    quiet = [
        q
        for kind in QUIET_WORDS
        for s in segments.of(kind)
        if (q := _quiet_segment(reference, *force, kind, s.t0, s.t1))
    ]
    if reference.kind != SMOOTHER:
        sound = [q for q in quiet if q.tilt <= SOUND_TILT_DEG]
        quiet = [q for q in quiet if q.tilt <= MAX_GRAVITY_TILT_DEG or not _turned_as_gyro(reference, imu, sound, q)]
    kind = next((k for k in QUIET_WORDS if any(q.kind == k for q in quiet)), None)
    if kind is None:
        return "", []
    tilts = [q.tilt for q in quiet if q.kind == kind]
    tilt, where = float(median(tilts)), QUIET_WORDS[kind]
    text = f"{where} {reference.source} and gravity in the accelerometer differ by this tilt (median of {len(tilts)})"
    step = AlignmentStep("gravity_check", text, tilt, "deg", f"accelerometer {where}", False)
    if tilt > MAX_GRAVITY_TILT_DEG:
        fault = f"{reference.source} disagrees with gravity {where} by {tilt:.0f} deg"
        return f"{fault}; it or the sensor's frame is wrong", [step]
    return _intermittent_fault(reference, quiet), [step]


def _intermittent_fault(reference: Reference, quiet: list[QuietSegment]) -> str:
    """Return a sentence if the reference is wrong in some quiet segments."""
    begin = float(reference.t[0]) + ALIGNED_S
    sound = [q for q in quiet if q.t0 >= begin and abs(q.force - GRAVITY_M_S2) <= GRAVITY_TOLERANCE_M_S2]
    wrong = [q for q in sound if q.tilt > MAX_GRAVITY_TILT_DEG]
    if len(wrong) < MIN_WRONG_SEGMENTS or sum(q.seconds for q in wrong) < MIN_WRONG_SHARE * sum(
        q.seconds for q in sound
    ):
        return ""
    worst = max(wrong, key=lambda q: q.tilt)
    return (
        f"{reference.source} is wrong by {worst.tilt:.0f} deg {QUIET_WORDS[worst.kind]} at {worst.t0:.0f} s; the "
        f"accelerometer shows {worst.force:.1f} m/s^2 there; so in {len(wrong)} of {len(sound)} such times"
    )


def _turned_as_gyro(reference: Reference, imu: Imu, sound: list[QuietSegment], wrong: QuietSegment) -> bool:
    """Return whether the reference turned as the gyro from the last sound quiet segment to one off gravity.

    Less the mean rate in the last sound rest, in which the gyro shows its bias.
    """
    before = [q for q in sound if wrong.t0 - MAX_GYRO_S <= q.t0 < wrong.t0]
    rests = [q for q in sound if q.kind == "rest" and q.t0 < wrong.t0]
    if not before:
        return False
    start = max(before, key=lambda q: q.t0)
    t0, t1 = (q.t0 + 0.5 * q.seconds for q in (start, wrong))
    gyro, edges = increments.gyro_increments(imu), np.linspace(t0, t1, max(int((t1 - t0) / GYRO_STEP_S), 2))
    q, _ = interpolate_attitudes(reference.t, reference.q, reference.gap_segment, edges[[0, -1]])
    if not gyro.known(edges[:1], edges[-1:]).all() or not np.isfinite(q).all():
        return False
    bias = np.zeros(3)
    if rests:
        rest = max(rests, key=lambda q: q.t0)
        bias = np.nan_to_num(gyro.mean_rates(np.array([rest.t0]), np.array([rest.t0 + rest.seconds]))[0])
    turns = gyro.between(edges[:-1], edges[1:]) - bias * np.diff(edges)[:, None]
    expected = rotation.rotate_inverse(rotation.multiply(q[0], rotation.product(rotation.from_rotvec(turns))), DOWN)
    apart = _angle(np.asarray(expected), np.asarray(rotation.rotate_inverse(q[1], DOWN)))
    return float(apart) < GYRO_SHARE * wrong.tilt


def _quiet_segment(
    reference: Reference, t: Array, force: Array, kind: str, t0: float, t1: float
) -> QuietSegment | None:
    """Return tilt and size of a segment's mean force, or None."""
    inside = time_slice(t, t0, t1)
    q = alignment.untrim(reference.q, reference.alignment.trim)
    mean = earth_force(t[inside], force[inside], reference.t, q, reference.segment, MAX_FORCE_SAMPLES)
    size = 0.0 if mean is None else float(np.sqrt(np.sum(mean**2)))
    return None if mean is None or size == 0.0 else QuietSegment(kind, t0, t1 - t0, tilt_deg(mean), size)


# Static tilt: at standstill gravity tests any attitude without a filter.

# Static tilt of nearly all sound onboard attitudes; accelerometer biases make half of it.
SOUND_TILT_DEG = 2.5
# Static tilt that contradicts a reference: in deg, and in its sigmas with 1 deg for the accelerometer.
MAX_TILT_DEG, SIGMAS, FLOOR_DEG = 3.0, 3.0, 1.0
# Or: in deg, and as a multiple of the onboard attitude's tilt.
DOUBTED_TILT_DEG, MIN_TILT_RATIO = 2.0, 2.0
# Largest own sigma (horizontal) and size of an accelerometer bias that a smoother knows: above, prior and tilt decide.
MAX_BIAS_SIGMA_M_S2, MAX_BIAS_M_S2 = 0.045, 1.0
# Largest distance of a window that borders a span.
BORDER_S = 1.0
# Smallest number of windows; a single one may be a slow landing.
MIN_STILL_WINDOWS = 3
# Shares of the still time and of all time in contradiction that refuse a whole part between gaps.
MIN_REFUSED_SHARE, MIN_REFUSED_SHARE_OF_ALL = 0.5, 0.2


@dataclass(frozen=True, slots=True, eq=False)
class StaticTilt:
    """Tilt (k,) in deg to gravity over still ``windows`` (k, 2) s.

    Of ``reference`` and ``onboard`` attitude, NaN where unknown. ``sigma`` (k,) deg: the reference's own sigma of tilt.
    ``unbiased`` (k,): tilt of the reference to the force less a bias of the accelerometer that motion shows.
    """

    windows: Array
    reference: Array
    onboard: Array
    sigma: Array
    unbiased: Array | None = None

    def medians(self, span: Span) -> tuple[float, float] | None:
        """Return the median tilts of reference and onboard attitude in a span.

        Without windows inside, those at its ends; None without any.
        """
        known = np.isfinite(self.reference) & np.isfinite(self.onboard)
        begin, end = self.windows.T
        inside = known & (begin >= span[0]) & (end <= span[1])
        if not inside.any():
            inside = known & (end >= span[0] - BORDER_S) & (begin <= span[1] + BORDER_S)
        if not inside.any():
            return None
        return float(median(self.reference[inside])), float(median(self.onboard[inside]))

    def supports_onboard(self, span: Span) -> bool:
        """Return whether gravity at standstill supports the onboard attitude around a span."""
        found = self.medians(span)
        return found is not None and not (found[1] > SOUND_TILT_DEG and found[1] > found[0])

    def contradicting(self) -> list[tuple[Span, float, float, float]]:
        """Return the spans in which gravity contradicts the reference.

        Each with the median tilt of the reference, that of the onboard attitude (NaN if unknown), and the median sigma.
        """
        with np.errstate(invalid="ignore"):
            limit = np.maximum(MAX_TILT_DEG, SIGMAS * np.hypot(self.sigma, FLOOR_DEG))
            bad = self.reference > limit
            bad |= (self.reference > DOUBTED_TILT_DEG) & (self.reference > MIN_TILT_RATIO * self.onboard)
            if self.unbiased is not None:
                bad &= self.unbiased > np.minimum(DOUBTED_TILT_DEG, limit)
        found = []
        for begin, end in spans.merge([(float(a), float(b)) for a, b in self.windows[bad]]):
            there = bad & (self.windows[:, 0] >= begin) & (self.windows[:, 1] <= end)
            if np.count_nonzero(there) < MIN_STILL_WINDOWS:
                continue
            onboard = self.onboard[there]
            theirs = float(nanmedian(onboard)) if np.isfinite(onboard).any() else np.nan
            found.append(((begin, end), float(median(self.reference[there])), theirs, float(median(self.sigma[there]))))
        return found


def static_tilt(log: FlightLog, reference: Reference, attitude: Attitude | None) -> StaticTilt | None:
    """Return static tilts of reference and logged attitude; None without standstill."""
    imu = log.replay_imu
    if imu is None or not len(windows := unit_still_windows(imu)):
        return None
    q = alignment.untrim(reference.q, reference.alignment.trim)
    of_reference = _residual(imu, windows, reference.t, q, reference.gap_segment)
    of_onboard = np.full(len(windows), np.nan)
    if attitude is not None:
        t, q, _ = alignment.usable_samples(attitude, reference.alignment.clock)
        q = alignment.untrim(q, log.parameters.trim if attitude.has_trim else None)
        of_onboard = _residual(imu, windows, t, q, model.number_segments(t))
    own = None if reference.sigma is None else reference.sigma.tilt_deg
    middle = windows.mean(axis=1)
    sigma = np.zeros(len(windows)) if own is None or not len(own) else np.interp(middle, reference.t, own)
    before = middle < reference.scoring.start  # filters still settle
    of_reference[before] = np.nan
    bias, unbiased = _known_bias(reference), None
    if bias is not None:
        q = alignment.untrim(reference.q, reference.alignment.trim)
        unbiased = _residual(imu, windows, reference.t, q, reference.gap_segment, bias)
    return StaticTilt(windows, of_reference, of_onboard, sigma, unbiased)


def _known_bias(reference: Reference) -> Array | None:
    """Return the accelerometer's bias (3,) in m/s^2 by a smoother whose motion shows it; None where it is unknown."""
    if reference.kind != SMOOTHER or reference.quality.get("heading_from") not in ("both", "motion"):
        return None
    read = [reference.quality.get(f"acc_bias_{axis}{kind}_m_s2") for kind in ("", "_sigma") for axis in "xyz"]
    values = np.array([x for x in read if isinstance(x, float)])
    if len(values) < 6:
        return None
    bias, level = values[:3], float(np.max(values[3:5]))
    known = level <= MAX_BIAS_SIGMA_M_S2 and float(np.max(np.abs(bias))) <= MAX_BIAS_M_S2
    return bias if known else None


def static_tilt_refusal(found: StaticTilt, reference: Reference, name: str) -> tuple[str, list[Span]]:
    """Return why gravity contradicts the whole reference (or ""), and contradicted spans.

    A part between gaps is contradicted as a whole if most of its still time and a fifth of its time are. ``name``:
    onboard attitude.
    """
    bad = found.contradicting()
    if not bad:
        return "", []
    wrong = [span for span, *_ in bad]
    known = spans.merge([(float(a), float(b)) for a, b in found.windows[np.isfinite(found.reference)]])
    refused, whole = list[Span](), 0
    numbers = unique(reference.gap_segment)
    for number in numbers:
        t = reference.t[reference.gap_segment == number]
        own = [(float(t[0]), float(t[-1]))]
        seconds = spans.seconds(spans.intersect(wrong, own))
        most = seconds > MIN_REFUSED_SHARE * spans.seconds(spans.intersect(known, own))
        throughout = most and seconds > MIN_REFUSED_SHARE_OF_ALL * (own[0][1] - own[0][0])
        refused += own if throughout else spans.intersect(wrong, own)
        whole += throughout
    if whole < len(numbers):
        return "", refused
    (begin, end), residual, onboard, sigma = max(bad, key=lambda one: one[0][1] - one[0][0])
    other = f", {name} {onboard:.1f} deg" if np.isfinite(onboard) else ""
    why = f"standing still from {begin:.0f} to {end:.0f} s it is {residual:.1f} deg off gravity (sigma {sigma:.1f})"
    return why + other, refused


@cached_per_log
def unit_still_windows(imu: Imu) -> Array:
    """Return the still windows (k, 2) s of an IMU."""
    n = min(len(imu.acc.t_best), len(imu.acc.x), len(imu.gyro.x))
    t, x = model.select_rising(imu.acc.t_best[:n], np.column_stack([imu.gyro.x[:n], imu.acc.x[:n]]))
    return still_windows(t, x[:, :3], x[:, 3:])


def _residual(
    imu: Imu, windows: Array, t: Array, q: Array, segment: NDArray[np.int64], bias: Array | float = 0.0
) -> Array:
    """Return tilts (k,) in deg of IMU attitudes to gravity over windows; ``bias`` (3,) m/s^2 of the force."""
    at, force = model.select_rising(imu.acc.t_best, imu.acc.x - bias)
    use = within(windows, at)
    at, force = at[use], force[use]
    turned, _ = interpolate_attitudes(t, rotation.normalize(q), segment, at)
    return tilt_residual(windows, at, force, turned)


# Test of the reference (onboard attitude, smoother) against agreeing filters and the mean force.
#
# A filter that differs from the reference may be wrong. Where several different filters agree and the reference
# differs, the mean specific force decides: in earth axes, without the change of velocity, it must be gravity. Without
# GNSS a smoother shares the model and the errors of ``mekf``: a smoother that agrees with this filter alone is no
# reference.

# Smallest number of filters that agree; they must also be half of those that ran.
MIN_FILTERS = 3
# Largest median distance of a filter from the common down; smallest distance of the reference, in deg and relative to
# the filters' spread.
MAX_SPREAD_DEG, MIN_APART_DEG, MIN_SPREAD_RATIO = 8.0, 15.0, 2.5
# Smallest share of the scored time with that distance, and shortest unbroken span.
MIN_APART_SHARE, MIN_APART_S = 0.2, 2.0
# Residual of the mean force without gravity: largest by the filters, smallest by the reference.
MAX_FORCE_RESIDUAL_M_S2, MIN_FORCE_FAULT_M_S2 = 1.0, 2.0
# Before filters run: a longer span contains one of 2 to 4 s with the same fault. Its ends are known to half a step, by
# which the mean force differs.
SPAN_STEP_S, SPAN_STEPS, POSSIBLE_SHARE, FORCE_RATE_HZ = 0.25, range(8, 17), 0.75, 100.0
SAMPLES = 4000  # of the reference: enough for medians
DOWN = np.array([0.0, 0.0, 1.0])


class ReferenceCheck:
    """Check of a reference against filters that are added one by one.

    Only each filter's down at the reference's times is kept; ``again`` re-runs one where the filters contradict the
    reference. A requested reference (``choice``) is not checked, nor is any with a faulty gyro or accelerometer: all
    filters share them and are one witness.
    """

    def __init__(
        self, log: FlightLog, imu: Imu, reference: Reference, again: Callable[[Track], Track], choice: str = "auto"
    ) -> None:
        self._log, self._imu, self._reference, self._again = log, imu, reference, again
        use = np.flatnonzero(scoring.scored_mask(reference, reference.t))
        self._use = use[:: max(1, len(use) // SAMPLES)].copy()  # without the copy the full index stays in memory
        sound = not reference.faults.gyro and sensor_faults.FRAME not in reference.faults.sensors
        checked = choice == "auto" and sound and reference.kind in ("onboard", "smoother")
        self._asked = checked and len(self._use) >= 10
        self._heard: dict[str, tuple[Track, Array]] = {}

    def may_refuse(self) -> bool:
        """Return whether filters might contradict the reference, whose mean force is somewhere not gravity."""
        if not self._asked:
            return False
        t0, t1 = self._reference.t[self._use[[0, -1]]]
        edges = np.arange(t0, t1 + SPAN_STEP_S, SPAN_STEP_S)
        most = max(int(FORCE_RATE_HZ * (t1 - t0)), 1)
        t, force = _known_force(self._imu, self._reference, self._reference.alignment.trim, t0, t1, most)
        at = np.searchsorted(t, edges)
        change = np.vstack([np.zeros(3), np.cumsum(force + np.array([0.0, 0.0, GRAVITY_M_S2]), axis=0)])[at]
        receiver = next((g for g in self._log.gnss if _moving(g).sum() > 3), None)
        velocity = np.zeros((len(edges), 3)) if receiver is None else _velocity(receiver, edges)
        for n in SPAN_STEPS:
            count = at[n:] - at[:-n]
            mean = (change[n:] - change[:-n]) / np.maximum(count, 1)[:, None]
            off = mean - (velocity[n:] - velocity[:-n]) / (n * SPAN_STEP_S)
            if (np.sqrt(np.sum(off[count > 0] ** 2, axis=1)) >= POSSIBLE_SHARE * MIN_FORCE_FAULT_M_S2).any():
                return True
        return False

    def add(self, row: Track) -> None:
        """Add a row; it replaces an earlier row of the same filter."""
        own = row.imu is None or row.imu.index == self._imu.index
        if self._asked and own and row.kind == "replay" and len(row.t) > 1 and row.estimator != SMOOTHER:
            self._heard[row.estimator] = row, _down(row.t, row.q, row.segment, self._reference.t[self._use])

    def contradicted(self) -> tuple[str, AlignmentStep] | None:
        """Return why the reference is refused, with its alignment step."""
        if len(self._heard) < MIN_FILTERS:
            return None
        filters, downs = [row for row, _ in self._heard.values()], np.stack([d for _, d in self._heard.values()])
        return _refuted_by_force(self._log, self._imu, self._reference, filters, downs, self._use, self._again)


def _refuted_by_force(
    log: FlightLog,
    imu: Imu,
    reference: Reference,
    filters: Sequence[Track],
    downs: Array,
    use: NDArray[np.int64],
    again: Callable[[Track], Track],
) -> tuple[str, AlignmentStep] | None:
    """Return the fault of a reference that agreeing filters and force contradict.

    ``downs`` (k, m, 3): down by k filters at the reference's samples ``use`` (m,).
    """
    t = reference.t[use]
    shared = np.isfinite(downs).all(axis=2).sum(axis=0) >= MIN_FILTERS
    if shared.sum() < 10:
        return None
    t, use, downs = t[shared], use[shared], downs[:, shared]
    own_down = rotation.rotate_inverse(reference.q[use], DOWN)
    common = nanmedian(downs, axis=0)
    common /= np.sqrt(np.sum(common**2, axis=1, keepdims=True))
    distance = _angle(downs, common)
    typical = np.array([median(d[np.isfinite(d)]) if np.isfinite(d).any() else np.inf for d in distance])
    near = np.flatnonzero(typical <= MAX_SPREAD_DEG)
    if len(near) < max(MIN_FILTERS, (len(filters) + 1) // 2):
        return None
    spread = np.max(np.nan_to_num(distance[near]), axis=0)
    angles = _angle(own_down, common)
    off = angles > np.maximum(MIN_APART_DEG, MIN_SPREAD_RATIO * spread)
    spans = [s for s in model.segment_slices(off, reference.segment[use]) if t[s.stop - 1] - t[s.start] >= MIN_APART_S]
    seconds = sum(float(t[s.stop - 1] - t[s.start]) for s in spans)
    if not spans or seconds < MIN_APART_SHARE * _seconds(t, reference.segment[use]):
        return None
    longest = max(spans, key=lambda s: float(t[s.stop - 1] - t[s.start]))
    t0, t1 = float(t[longest.start]), float(t[longest.stop - 1])
    try:
        nearest = again(filters[int(near[np.argmin(typical[near])])])
    except AttlogError:
        return None
    by_filter = _mean_force(imu, nearest, reference.alignment.trim, t0, t1)
    by_reference = _mean_force(imu, reference, reference.alignment.trim, t0, t1)
    if by_filter is None or by_reference is None:
        return None
    gravity = np.array([0.0, 0.0, -GRAVITY_M_S2]) + _acceleration(log, t0, t1)
    right, wrong = (float(np.sqrt(np.sum((f - gravity) ** 2))) for f in (by_filter, by_reference))
    if right > MAX_FORCE_RESIDUAL_M_S2 or wrong < MIN_FORCE_FAULT_M_S2:
        return None
    angle = float(median(angles[longest]))
    who = "all" if len(near) == len(filters) else "most"
    fault = f"{reference.source} is wrong by {angle:.0f} deg: {who} filters agree, and their mean force is gravity"
    text = (
        f"Filters stay within {median(spread):.0f} deg of each other; from {t0:.1f} to {t1:.1f} s the mean force is "
        f"{_shown(by_filter)} m/s^2 (north, east, down) by them and {_shown(by_reference)} by {reference.source}"
    )
    return fault, AlignmentStep("contradiction", text, angle, "deg", reference.source, False)


def _seconds(t: Array, segment: NDArray[np.int64]) -> float:
    """Return the time in s covered by samples (n,) within segments."""
    dt = np.diff(t)
    return float(dt[np.diff(segment) == 0].sum())


def _down(t: Array, q: Array, segment: NDArray[np.int64], at: Array) -> Array:
    """Return down in body axes (n, 3) at times, NaN without attitude."""
    turned, _ = interpolate_attitudes(t, q, segment, at)
    found: Array = np.full((len(at), 3), np.nan)
    good = rotation.finite_rows(turned)
    found[good] = rotation.rotate_inverse(turned[good], DOWN)
    return found


def _angle(a: Array, b: Array) -> Array:
    """Return angles in deg between unit vectors (..., 3)."""
    angle: Array = np.degrees(np.arccos(np.clip(np.sum(a * b, axis=-1), -1.0, 1.0)))
    return angle


def _mean_force(imu: Imu, attitude: Reference | Track, trim: Array | None, t0: float, t1: float) -> Array | None:
    """Return the mean specific force (3,) in earth axes by an attitude over [t0, t1] s."""
    _, earth = _known_force(imu, attitude, trim, t0, t1, SAMPLES)
    return np.asarray(earth.mean(axis=0)) if len(earth) else None


def _known_force(
    imu: Imu, attitude: Reference | Track, trim: Array | None, t0: float, t1: float, most: int
) -> tuple[Array, Array]:
    """Return times (k,) s and specific forces (k, 3) in earth axes over [t0, t1] s, thinned to about ``most``."""
    at = imu.acc.t_best
    inside = np.flatnonzero((at >= t0) & (at <= t1) & rotation.finite_rows(imu.acc.x))
    inside = inside[:: max(1, len(inside) // most)]
    q = alignment.untrim(attitude.q, trim)
    return known_earth_force(at[inside], imu.acc.x[inside], attitude.t, q, attitude.segment)


def _acceleration(log: FlightLog, t0: float, t1: float) -> Array:
    """Return the mean acceleration (3,) m/s^2 NED by GNSS, zero if unknown."""
    for gnss in log.gnss:
        good = _moving(gnss)
        if good.sum() > 3 and gnss.t[good][0] <= t0 + 1.0 and gnss.t[good][-1] >= t1 - 1.0:
            begin, end = _velocity(gnss, np.array([t0, t1]))
            change: Array = (end - begin) / (t1 - t0)
            return change
    return np.zeros(3)


def _moving(gnss: Gnss) -> NDArray[np.bool_]:
    """Return where a receiver knows its velocity."""
    known: NDArray[np.bool_] = (gnss.fix >= 3) & rotation.finite_rows(gnss.vel_ned)
    return known


def _velocity(gnss: Gnss, t: Array) -> Array:
    """Return velocities (n, 3) m/s NED at times (n,) s."""
    good = _moving(gnss)
    return np.stack([np.interp(t, gnss.t[good], gnss.vel_ned[good, k]) for k in range(3)], axis=1)


def _shown(force: Array) -> str:
    return " ".join(f"{x:.2f}" for x in force + 0.0)
