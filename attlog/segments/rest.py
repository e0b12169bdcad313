"""Rest, idling, hover and vibration by the IMU, and the autopilot's flags of arming and flight.

Noise and gyro offset are measured at rest, so hover must be excluded: the noise limit scales with the log's quietest
windows and is capped, because otherwise a calm hover passes in a log with little rest. Flags are used only where
sensors are missing: land detectors are seconds late, and some are never updated.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation, spans
from attlog.core.sorting import median, quantile
from attlog.core.spans import Span, inside
from attlog.flight.model import FlightLog, Imu, Stream, TimeLine
from attlog.segments import flight_signs, model
from attlog.segments.airborne import InAir
from attlog.segments.model import Segment

Array = NDArray[np.float64]

MIN_WINDOW_S = 0.5  # short against rests, long against samples
# Minimum samples for a standard deviation: slow logs get longer windows.
MIN_WINDOW_SAMPLES = 5

# Windows per pass, to limit memory on long logs.
WINDOWS_PER_PASS = 2048


@dataclass(slots=True)
class ImuWindows:
    """Statistics of the IMU in windows [t0, t1], (m,) and (m, 3); ``segment`` numbers continuous segments.

    ``rate``: mean body rate. ``rate_std``: standard deviation of the gyro (rms of three axes). ``rate_rms``: rms of the
    rate's length, all in deg/s. ``force`` and ``force_std``: mean and standard deviation of the specific force's length
    in m/s^2.
    """

    t0: Array
    t1: Array
    segment: NDArray[np.int64]
    rate: Array
    rate_std: Array
    rate_rms: Array
    force: Array
    force_std: Array
    seconds: float

    @property
    def middle(self) -> Array:
        """Middles of the windows (m,) in s."""
        return 0.5 * (self.t0 + self.t1)


def build_windows(t: Array, gyro: Array, acc: Array) -> ImuWindows:
    """Return window statistics of good samples: gyro in rad/s, accelerometer in m/s^2.

    Windows of fewer than 3 samples are dropped.
    """
    dt = np.diff(t)
    usual = float(median(dt[dt > 0])) if np.any(dt > 0) else MIN_WINDOW_S
    seconds = max(MIN_WINDOW_S, MIN_WINDOW_SAMPLES * usual)
    segment = model.number_segments(t)
    segment_start = t[np.searchsorted(segment, segment)]
    number = np.floor((t - segment_start) / seconds).astype(np.int64)
    key = np.flatnonzero(np.concatenate([[True], (np.diff(segment) != 0) | (np.diff(number) != 0)]))
    count = np.diff(np.append(key, len(t)))
    blocks = np.arange(0, len(key), WINDOWS_PER_PASS)
    values = np.concatenate(
        [
            _statistics(gyro, acc, key[a : a + WINDOWS_PER_PASS], count[a : a + WINDOWS_PER_PASS])
            for a in blocks.tolist()
        ],
        axis=0,
    )
    start = segment_start[key] + number[key] * seconds
    end = np.minimum(start + seconds, t[key + count - 1] + usual)
    keep = count >= 3
    values = values[keep]
    return ImuWindows(
        start[keep],
        end[keep],
        segment[key][keep],
        rate=values[:, 0:3],
        rate_std=values[:, 3],
        rate_rms=values[:, 4],
        force=values[:, 5],
        force_std=values[:, 6],
        seconds=seconds,
    )


def _statistics(gyro: Array, acc: Array, key: NDArray[np.int64], count: NDArray[np.int64]) -> Array:
    """Return columns (m, 7) of the windows at samples ``key``: rate, rate_std, rate_rms, force, force_std."""
    samples = slice(int(key[0]), int(key[-1] + count[-1]))
    rate = np.degrees(gyro[samples])
    force = rotation.length(acc[samples])
    first = key - key[0]

    def mean(x: Array) -> Array:
        return (np.add.reduceat(x, first, axis=0).T / count).T

    rate_mean, force_mean = mean(rate), mean(force)
    spread = rate - np.repeat(rate_mean, count, axis=0)
    return np.column_stack(
        [
            rate_mean,
            np.sqrt(mean(np.einsum("ni,ni->n", spread, spread) / 3.0)),
            np.sqrt(mean(np.einsum("ni,ni->n", rate, rate))),
            force_mean,
            np.sqrt(mean((force - np.repeat(force_mean, count)) ** 2)),
        ]
    )


def join_windows(windows: ImuWindows, passed: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return spans (t0, t1) in s of consecutive windows in one segment that all passed."""
    i = np.flatnonzero(passed)
    if len(i) == 0:
        return []
    new = (windows.t0[i[1:]] - windows.t1[i[:-1]] > 0.1 * windows.seconds) | (
        windows.segment[i[1:]] != windows.segment[i[:-1]]
    )
    first = np.concatenate([[0], np.flatnonzero(new) + 1])
    last = np.append(first[1:], len(i)) - 1
    return [(float(windows.t0[i[a]]), float(windows.t1[i[b]])) for a, b in zip(first, last, strict=True)]


# --- vibration ---------------------------------------------------------------------------------------------------

# Vibration is the force minus its moving mean over 0.2 s; its RMS is taken over 1 s.
VIBRATION_MEAN_S, VIBRATION_WINDOW_S = 0.2, 1.0


def vibration_levels(imu: Imu, within: list[Span]) -> tuple[Array, Array]:
    """Return starts (m,) in s of 1 s windows within spans and their vibration RMS (m, 3)."""
    t, acc = imu.acc.t_best, imu.acc.x
    good = np.isfinite(t) & rotation.finite_rows(acc) & inside(t, within)
    t, acc = t[good], acc[good]
    if len(t) < 10:
        return np.zeros(0), np.zeros((0, 3))
    starts, found = [], []
    for part in model.segment_slices(np.ones(len(t), bool), model.number_segments(t)):
        n = max(3, round(VIBRATION_MEAN_S * (part.stop - part.start - 1) / max(t[part.stop - 1] - t[part.start], 1e-9)))
        if part.stop - part.start < 3 * n:
            continue
        fast = acc[part] - centred_mean(acc[part], n)
        window = np.floor((t[part] - t[part.start]) / VIBRATION_WINDOW_S).astype(np.int64)
        first = np.flatnonzero(np.diff(window, prepend=-1))
        count = np.diff(np.append(first, len(window)))
        mean = np.add.reduceat(fast**2, first, axis=0) / count[:, None]
        full = count >= 0.8 * median(count)
        starts.append(t[part][first][full])
        found.append(np.sqrt(mean[full]))
    return (np.concatenate(starts), np.concatenate(found)) if starts else (np.zeros(0), np.zeros((0, 3)))


def centred_mean(x: Array, n: int) -> Array:
    """Return the centred moving mean (m, k) over ``n`` samples, over fewer at the ends."""
    total = np.concatenate([np.zeros((1, x.shape[1])), np.cumsum(x, axis=0)])
    i = np.arange(len(x))
    low, high = np.maximum(i - n // 2, 0), np.minimum(i + (n - n // 2), len(x))
    mean: Array = (total[high] - total[low]) / (high - low)[:, None]
    return mean


# Find rest, idling and hover by the IMU, and weigh the autopilot's flags of arming and flight.
#
# Noise and gyro offset are measured at rest, so hover must be excluded: the noise limit scales with the log's
# quietest
# windows and is capped, because otherwise a calm hover passes in a log with little rest. Flags are used only where
# sensors are missing: land detectors are seconds late, and some are never updated.

# Minimum time at rest that excludes flight by a land detector where arming is not logged.
MIN_LYING_S = 5.0
# Maximum output of a stopped motor, as a share of its range.
MAX_STOPPED_OUTPUT = 0.01


@dataclass(slots=True)
class FlagSpans:
    """Spans of a phase with their source; ``known``: logged, ``measured``: by motor outputs."""

    known: bool
    spans: list[Span] = field(default_factory=list)
    why: str = ""
    measured: bool = False


def flag_spans(line: TimeLine, wanted: bool, t0: float, t1: float) -> list[Span]:
    """Return the spans of [t0, t1] in which a flag equals ``wanted``.

    The first entry also applies to the time before it.
    """
    if not line.value:
        return []
    t = np.concatenate([[t0], np.clip(np.asarray(line.t, np.float64), t0, t1), [t1]])
    values = [bool(v) for v in line.value]
    entries = zip(t[:-1], t[1:], [values[0], *values], strict=True)
    return spans.merge((float(a), float(b)) for a, b, value in entries if value is wanted and b > a)


def armed_spans(log: FlightLog, t0: float, t1: float) -> FlagSpans:
    """Return the armed spans by the autopilot's flag."""
    if log.state.armed is None or not log.state.armed.value:
        return FlagSpans(False, why="the log holds no arming state")
    return FlagSpans(True, flag_spans(log.state.armed, True, t0, t1), f"armed by {log.state.armed.source}")


def airborne_spans(
    log: FlightLog, armed: FlagSpans, air: InAir | None, flights: list[Span], lying: list[Span], t0: float, t1: float
) -> FlagSpans:
    """Return the airborne spans by sensors, else by the land detector.

    ``air``: signs of flight over [t0, t1] s. ``flights``: flights outside wrecks. ``lying``: spans still as the ground.
    """
    if not log.kind.flies:
        return FlagSpans(True, [], f"a {log.vehicle} does not fly")
    if air is not None and air.known:
        return FlagSpans(True, flights, air.why)
    if log.state.landed is None or not log.state.landed.value:
        missing = "throttle" if air is None or air.power_source == "arming" else "height"
        return FlagSpans(False, why=f"the log holds no land detector and no {missing} to replace it")
    not_landed = flag_spans(log.state.landed, False, t0, t1)
    on_ground = [s for s in lying if s[1] - s[0] >= MIN_LYING_S]
    kept = spans.intersect(not_landed, armed.spans if armed.known else spans.complement(on_ground, t0, t1))
    return FlagSpans(True, kept, f"not landed by {log.state.landed.source}, and no sensor that could check it")


def motor_spans(log: FlightLog, armed: FlagSpans, t0: float, t1: float) -> FlagSpans:
    """Return spans of turning motors by outputs, else arming, rotor speed or throttle."""
    if log.power.motors is not None and len(log.power.motors.t) > 1:
        return FlagSpans(
            True,
            _spans_above(log.power.motors, MAX_STOPPED_OUTPUT),
            f"motors turn by {log.power.motors.source}",
            measured=True,
        )
    if armed.known:
        return FlagSpans(True, armed.spans, "armed")
    for name, stream, limit in (("RPM", log.power.rpm, 100.0), ("throttle", log.power.throttle, 0.05)):
        if stream is not None and len(stream.t) > 1 and (name != "RPM" or np.fmax.reduce(stream.x, axis=None) > limit):
            return FlagSpans(True, _spans_above(stream, limit), f"motors turn by {name}")
    return FlagSpans(False, [], "nothing shows whether motors turned")


def busy_spans(armed: FlagSpans, motors: FlagSpans) -> list[Span]:
    """Return spans that exclude rest: motors turning, and arming up to their last turn."""
    last = [(a, max((d for _, d in spans.intersect([(a, b)], motors.spans)), default=a)) for a, b in armed.spans]
    return spans.merge([*motors.spans, *last])


def _spans_above(stream: Stream, limit: float) -> list[Span]:
    """Return spans in which any column of a stream exceeds a limit."""
    turning = np.nanmax(np.nan_to_num(stream.x.reshape(len(stream.t), -1)), axis=1) > limit
    entries = zip(stream.t[:-1], stream.t[1:], turning[:-1], strict=True)
    return spans.merge((float(a), float(b)) for a, b, on in entries if on)


# --- rest and idling ---------------------------------------------------------------------------------------------

Mask = NDArray[np.bool_]

MIN_RATE_STD_DPS, MAX_RATE_STD_DPS, RATE_STD_FACTOR = 0.15, 0.6, 4.0  # bounds, and multiple of the log's floor
MAX_FORCE_STD_M_S2 = 0.15  # noise of the force at rest
MAX_MEAN_RATE_DPS = 0.3  # difference from the median mean rate of still windows nearby
NEIGHBOURS_S = 30.0  # time on each side in which the gyro bias is taken as constant
# Tuned on simulated flights with truth and on real logs.
MIN_LONG_REST_S, MIN_SHORT_REST_S, MIN_IDLE_S = 10.0, 2.0, 1.0
IDLE_RATE_DPS = 1.0  # maximum mean rate on the ground
# Maximum mean rate where no rest gives the gyro offset.
IDLE_OFFSET_DPS = 3.0

# Minimum mean force at rest; below it the accelerometer does not measure gravity.
MIN_FORCE_M_S2 = 1.0


def still_rate_limit(windows: ImuWindows) -> float:
    """Return the largest standard deviation of the gyro at rest in deg/s: clip(4 x floor, 0.15, 0.6)."""
    if len(windows.t0) == 0:
        return MIN_RATE_STD_DPS
    floor = quantile(windows.rate_std, 0.02)
    return float(np.clip(RATE_STD_FACTOR * floor, MIN_RATE_STD_DPS, MAX_RATE_STD_DPS))


def largest_rate_limit(windows: ImuWindows, motors: FlagSpans) -> float:
    """Return the largest standard deviation of the gyro that counts as rest in a log, deg/s."""
    return MAX_RATE_STD_DPS if motors.measured else still_rate_limit(windows)


def still_windows(windows: ImuWindows, motors: FlagSpans) -> Mask:
    """Mark windows (m,) as still as the ground: little noise, steady mean rate.

    The mean rate is compared with quiet windows within 30 s. The noise limit is capped because a calm hover is nearly
    as quiet. Where motor outputs show stopped motors hover is impossible, and the cap itself is the limit.
    """
    limit = np.full(len(windows.t0), still_rate_limit(windows))
    if motors.measured:
        limit[~spans.overlaps(windows.t0, windows.t1, motors.spans)] = MAX_RATE_STD_DPS
    quiet = (windows.rate_std < limit) & (windows.force_std < MAX_FORCE_STD_M_S2)
    quiet &= windows.force > MIN_FORCE_M_S2
    around = _median_around(windows, quiet)
    off = np.sqrt(np.sum((windows.rate - around) ** 2, axis=1))
    steady: Mask = quiet & (off < MAX_MEAN_RATE_DPS)
    return steady


def find_rests(
    windows: ImuWindows, still: Mask, airborne: FlagSpans, motors: FlagSpans, busy: list[Span], moving: Mask
) -> list[Segment]:
    """Return long and short rests; ``moving`` marks windows with GNSS speed or climb."""
    forbidden = [*airborne.spans, *busy]
    passed = still & ~moving & ~spans.overlaps(windows.t0, windows.t1, forbidden)
    limit = largest_rate_limit(windows, motors)
    known = ["not airborne"] if airborne.known else []
    known += [f"not {motors.why}" if motors.why == "armed" else "motors stand still"] if motors.known else []
    found = []
    for t0, t1 in join_windows(windows, passed):
        if t1 - t0 < MIN_SHORT_REST_S:
            continue
        kind = "rest.long" if t1 - t0 >= MIN_LONG_REST_S else "rest.short"
        inside = (windows.t0 >= t0 - 1e-9) & (windows.t1 <= t1 + 1e-9)
        noise = float(median(windows.rate_std[inside]))
        why = f"gyro noise {noise:.3f} deg/s (limit {limit:.2f}), accelerometer and mean rate steady"
        found.append(Segment(kind, t0, t1, ", ".join([why, *known])))
    return found


def find_idles(
    windows: ImuWindows, still: Mask, airborne: FlagSpans, motors: FlagSpans, rests: list[Span]
) -> list[Segment]:
    """Return spans on the ground with motors turning, outside rest; none where flight is unknown."""
    if not airborne.known:
        return []
    offset = median(windows.rate[still], axis=0) if still.any() else np.zeros(3)
    limit = IDLE_RATE_DPS if still.any() else IDLE_OFFSET_DPS
    slow = np.sqrt(np.sum((windows.rate - offset) ** 2, axis=1)) < limit
    turning = spans.overlaps(windows.t0, windows.t1, motors.spans)
    passed = slow & turning & ~spans.overlaps(windows.t0, windows.t1, airborne.spans)
    allowed = spans.intersect(motors.spans, spans.complement(rests, -np.inf, np.inf))
    return [
        Segment("idle", t0, t1, f"{motors.why}, on the ground, mean rate under {limit:.0f} deg/s")
        for t0, t1 in spans.intersect(join_windows(windows, passed), allowed)
        if t1 - t0 >= MIN_IDLE_S
    ]


def _median_around(windows: ImuWindows, quiet: Mask) -> Array:
    """Return the median mean rate (m, 3) of quiet windows within 30 s, NaN without any."""
    around = np.full((len(quiet), 3), np.nan)
    i = np.flatnonzero(quiet)
    if len(i) == 0:
        return around
    t, rate = windows.middle[i], windows.rate[i]
    low = np.searchsorted(t, t - NEIGHBOURS_S, side="left")
    high = np.searchsorted(t, t + NEIGHBOURS_S, side="right")
    width = int(np.max(high - low))
    for a in range(0, len(i), 2048):
        block = slice(a, a + 2048)
        columns = low[block, None] + np.arange(width)
        beyond = columns >= high[block, None]
        values = rate[np.minimum(columns, len(i) - 1)]
        values[beyond] = np.inf
        values.sort(axis=1)
        count = high[block] - low[block]
        rows = np.arange(len(count))
        around[i[block]] = 0.5 * (values[rows, (count - 1) // 2] + values[rows, count // 2])
    return around


# --- hover -------------------------------------------------------------------------------------------------------

# A tilt limit of 10 deg loses two thirds of a hover in wind.
MIN_HOVER_S, MAX_HOVER_RATE_DPS, MAX_HOVER_TILT_DEG, MAX_HOVER_SPEED_M_S = 3.0, 10.0, 20.0, 1.0


def find_hovers(log: FlightLog, windows: ImuWindows, airborne: FlagSpans) -> list[Segment]:
    """Return hovers of at least 3 s: airborne, rate < 10 deg/s rms, tilt < 20 deg, speed < 1 m/s.

    Unknown tilt or speed passes.
    """
    if not airborne.spans or not log.kind.hovers:
        return []
    wholly = ~spans.overlaps(windows.t0, windows.t1, spans.complement(airborne.spans, -np.inf, np.inf))
    slow = windows.rate_rms < MAX_HOVER_RATE_DPS
    tilt = flight_signs.tilt_at(log, windows.middle)
    speed = flight_signs.speed_at(log, windows.middle)
    passed = wholly & slow & ~(tilt >= MAX_HOVER_TILT_DEG) & ~(speed >= MAX_HOVER_SPEED_M_S)
    limits = [f"rate under {MAX_HOVER_RATE_DPS:.0f} deg/s"]
    limits += [f"tilt under {MAX_HOVER_TILT_DEG:.0f} deg"] if np.isfinite(tilt).any() else ["tilt unknown"]
    limits += [f"speed under {MAX_HOVER_SPEED_M_S:.0f} m/s"] if np.isfinite(speed).any() else ["speed unknown"]
    return [Segment("hover", a, b, ", ".join(limits)) for a, b in join_windows(windows, passed) if b - a >= MIN_HOVER_S]
