"""IMUs against each other, with the faulty one of a pair, and over temperature.

The faster IMU is interpolated to the samples of the slower one; medians over blocks of 5 s suppress noise and
vibration. The faulty IMU of three is the one that differs from two that agree. Of two it is the one further from
gravity or zero rate at rest, else the one with the larger bias by the smoother. A difference in flight alone is
vibration.
"""

from __future__ import annotations

from functools import partial
from itertools import combinations
from typing import Literal, NamedTuple

import numpy as np

from attlog.core import rotation
from attlog.core.log_cache import cached_per_log
from attlog.core.sorting import median, unique
from attlog.core.spans import Span, between, inside
from attlog.flight.model import Array, Imu, Stream
from attlog.health import gravity
from attlog.health.check import Check, HealthCase, Limits, Verdict, graded, unknown
from attlog.health.flown import flight_spans, still_spans
from attlog.health.gravity import expected_gravity, force_size
from attlog.health.imu import (
    Blocks,
    axes_text,
    blocks,
    finite_samples,
    smoothed_acc_bias,
    smoothed_gyro_bias,
    stream_blocks,
    usable_imus,
)
from attlog.health.regression import interval_text

Kind = Literal["acc", "gyro"]


# Significance of a difference.
SIGMAS = 4.0
PAIR_LIMITS: dict[Kind, Limits] = {
    "acc": Limits("imu_instances", "m/s^2", 0.5, 0.75, "ok up to 0.5 m/s^2 or 4 sigma, fault above 0.75",
                  "3 deg of tilt; arming checks refuse from 0.7 to 0.75 m/s^2", 0.02),
    "gyro": Limits("imu_instances", "deg/s", 1.0, 5.0, "ok up to 1 deg/s or 4 sigma, fault above 5",
                   "the limit of a gyro's bias; arming checks refuse from 5 deg/s", 0.02),
}  # fmt: skip
# Minimum error of the faulty IMU.
MIN_ERRORS: dict[Kind, float] = {"acc": 0.15, "gyro": 0.5}
# Maximum difference of duplicate streams in m/s^2 or rad/s, a hundredth of that of simulated sensors without noise.
DUPLICATE_DIFFERENCE = 1e-5
# Minimum rate in flight: vibration is aliased in slower ones (difference of 1.3 m/s^2 at 2 Hz, none at rest).
MIN_FLOWN_HZ, IN_FLIGHT = 10.0, "in flight"
# Minimum ratio of the faulty IMU's error to the other's.
LARGER_FACTOR = 2.0
# An accelerometer shakes whose samples scatter by this factor more than another's in flight, and by this many m/s^2.
SHAKEN_FACTOR, MIN_SHAKEN_M_S2 = 3.0, 1.0


def imu_differences(case: HealthCase) -> list[Check]:
    """Check accelerometer and gyro of each other IMU against the replayed one."""
    units = usable_imus(case)
    if len(units) < 2:
        return []
    odd = {kind: _odd_unit(case, kind, units) for kind in PAIR_LIMITS}
    pairs = [(kind, units[0], other, odd[kind]) for other in units[1:] for kind in PAIR_LIMITS]
    if found := [one for pair in pairs if (one := _pair_check(case, *pair)) is not None]:
        repeated = [c for kind in PAIR_LIMITS if odd[kind] is units[0] for c in _repeats(found, PAIR_LIMITS[kind].unit)]
        return [check for check in found if check not in repeated]
    limits = PAIR_LIMITS["acc"]
    why = "The units share too little time, at rest or in flight, or shake too much to be compared."
    return [unknown("imu_instances", why, limits.text, sensor=units[0].acc.source, source=limits.source)]


def _repeats(found: list[Check], unit: str) -> list[Check]:
    """Return the troubles in a unit of measure besides the largest: the replayed IMU differs from each other one."""
    same = [check for check in found if check.unit == unit and check.is_trouble]
    return sorted(same, key=lambda check: -(check.value or 0.0))[1:]


def _odd_unit(case: HealthCase, kind: Kind, units: list[Imu]) -> Imu | None:
    """Return the one of three or more IMUs that differs from all others, which agree with each other."""
    if len(units) < 3:
        return None
    limits = PAIR_LIMITS[kind]
    differs: dict[tuple[int, int], bool] = {}
    for (j, a), (k, b) in combinations(enumerate(units), 2):
        if not (every := _imu_differences(case, kind, a, b)):
            return None
        differs[j, k] = any(d.size > max(limits.ok, SIGMAS * d.unsure) for d in every)
    for k, unit in enumerate(units):
        if all(apart is (k in pair) for pair, apart in differs.items()):
            return unit
    return None


def _shaken_unit(case: HealthCase, a: Imu, b: Imu) -> tuple[Imu, str] | None:
    """Return the one of two accelerometers that scatters much more in flight, and the evidence."""
    found = [stream_blocks(imu.acc, flight_spans(case.segments)) for imu in (a, b)]
    sizes = [float(np.sqrt(np.sum(one.spread**2))) for one in found if one is not None]
    k = _larger_index(sizes, MIN_SHAKEN_M_S2, SHAKEN_FACTOR)
    if k is None:
        return None
    one, other = (a, b)[k], (a, b)[1 - k]
    text = f"In flight {one.acc.source} scatters by {sizes[k]:.1f} m/s^2, {other.acc.source} by {sizes[1 - k]:.1f}: "
    return one, f"{text}vibration at {one.acc.source}."


def difference(a: Stream, b: Stream, spans: list[Span]) -> Blocks | None:
    """Return blocks of ``b`` minus ``a`` within spans; None without common time."""
    if not spans:
        return None
    fast, slow, sign = (a, b, 1.0) if a.rate >= b.rate else (b, a, -1.0)
    (t_fast, x_fast), (t, x) = finite_samples(fast, spans), finite_samples(slow, spans)
    if len(t_fast) < 2 or len(t) == 0:
        return None
    use = (t >= t_fast[0]) & (t <= t_fast[-1])
    t, x = (t, x) if use.all() else (t[use], x[use])
    more = sign * (x - np.column_stack([np.interp(t, t_fast, column) for column in x_fast.T]))
    found = blocks(t, more, spans)
    # Equal streams are duplicates: after a switch the stream of the IMU in use repeats that of another IMU.
    return None if found is None or bool(np.all(found.spread < DUPLICATE_DIFFERENCE)) else found


@cached_per_log
def difference_in_flight(case: HealthCase, kind: Kind, a: Imu, b: Imu) -> Blocks | None:
    """Return blocks of ``b`` minus ``a`` in flight, rad/s or m/s^2; None without any."""
    return difference(getattr(a, kind), getattr(b, kind), flight_spans(case.segments))


class ImuDifference(NamedTuple):
    """Difference of two IMUs in a ``phase``: ``middle`` (3,) with ``sigma`` (3,)."""

    middle: Array
    sigma: Array
    blocks: Blocks
    phase: str

    @property
    def size(self) -> float:
        """Length of the vector."""
        return float(np.sqrt(np.sum(self.middle**2)))

    @property
    def unsure(self) -> float:
        """Error of the size."""
        along = float(np.sqrt(np.sum((self.middle * self.sigma) ** 2)))
        return along / self.size if self.size > 0.0 else float(self.sigma.max())

    def text(self, unit: str) -> str:
        """Format the size in ``unit`` with its phase."""
        return f"{self.size:.2f} ± {1.96 * self.unsure:.2f} {unit} {self.phase}"


def _imu_differences(case: HealthCase, kind: Kind, a: Imu, b: Imu) -> list[ImuDifference]:
    """Return the significant differences at rest and in flight, in deg/s or m/s^2."""
    limits, factor = PAIR_LIMITS[kind], 1.0 if kind == "acc" else float(np.degrees(1.0))
    one, two = (getattr(imu, kind) for imu in (a, b))
    rest, where = still_spans(case.segments)
    phases = [(difference(one, two, rest), where)]
    if min(one.rate, two.rate) >= MIN_FLOWN_HZ:
        phases.append((difference_in_flight(case, kind, a, b), IN_FLIGHT))
    found = []
    for more, phase in phases:
        if more is not None:
            sigma = np.hypot(factor * more.sigma(0.0), limits.floor)
            found.append(ImuDifference(factor * more.middle, sigma, more, phase))
    return [d for d in found if 1.96 * d.unsure <= limits.ok or d.size > SIGMAS * d.unsure]


def _pair_check(case: HealthCase, kind: Kind, a: Imu, b: Imu, odd: Imu | None = None) -> Check | None:
    """Check the larger difference of two IMUs, at rest or in flight; ``odd``: the one that others contradict."""
    limits, every = PAIR_LIMITS[kind], _imu_differences(case, kind, a, b)
    if not every:
        return None
    worst = max(every, key=lambda one: one.size - SIGMAS * one.unsure)
    verdict: Verdict = "ok"
    wrong, why, remedy = None, "", case.log.remedy("accelerometer" if kind == "acc" else "gyro_bias")
    if worst.size > max(limits.ok, SIGMAS * worst.unsure):
        verdict = "fault" if worst.size - 1.96 * worst.unsure > limits.fault else "warning"
        grounded = any(d.size + 1.96 * d.unsure <= limits.ok for d in every)
        shaken = _shaken_unit(case, a, b) if kind == "acc" and worst.phase == IN_FLIGHT else None
        if shaken is not None or (worst.phase == IN_FLIGHT and grounded):
            verdict, remedy = "warning", case.log.remedy("vibration")
            wrong, why = shaken or (None, "On the ground they agree, so vibration causes the difference.")
        elif odd is a or odd is b:
            wrong, why = odd, f"{odd.acc.source} is off: the others agree."
        else:
            wrong, why = _faulty_imu(case, kind, a, b, worst.middle)
    text = f"{b.acc.source} and {a.acc.source} differ by {worst.text(limits.unit)} ({axes_text(worst.middle)})."
    sensor = (wrong or (b if verdict == "ok" or not why else a)).acc.source
    check = Check("imu_instances", verdict, f"{text} {why}".strip(), unit=limits.unit, sensor=sensor)
    check.threshold, check.source = limits.text, limits.source
    check.n, check.seconds = worst.blocks.samples, round(worst.blocks.seconds, 1)
    check.kind, check.action = "gyro_bias" if kind == "gyro" else "", "" if verdict == "ok" else remedy
    check.evidence = [f"They differ by {d.text(limits.unit)}." for d in every if d is not worst]
    return check.measure(worst.size, worst.unsure, 3, least=0.0).measure_axes(worst.middle, worst.sigma, 3)


def _faulty_imu(case: HealthCase, kind: Kind, a: Imu, b: Imu, apart: Array) -> tuple[Imu | None, str]:
    """Return the faulty one of two IMUs with the evidence, or None with the reason.

    ``apart`` (3,) m/s^2 or deg/s: ``b`` minus ``a``.
    """
    least = MIN_ERRORS[kind]
    if kind == "acc":
        g = expected_gravity(case.log)
        shown = [gravity.size_at_rest(case, imu) for imu in (a, b)]
        sizes = [abs(float(one.middle[0]) - g) for one in shown if one is not None]
        by = f"gravity {still_spans(case.segments)[1]}"
    else:
        spans = still_spans(case.segments)[0]
        rates = [stream_blocks(imu.gyro, spans) for imu in (a, b)]
        sizes = [float(np.degrees(rotation.length(one.middle[None])[0])) for one in rates if one is not None]
        by = "the rate while standing still"
    wrong = _larger_index(sizes, least)
    if wrong is None and len(sizes) > 1 and min(sizes) >= least:
        return None, f"By {by} both are off ({sizes[0]:.2f} and {sizes[1]:.2f} {PAIR_LIMITS[kind].unit})."
    if wrong is None and (known := _offset_found(case, a, b) if kind == "acc" else None) is not None:
        return known, f"{known.acc.source} is off by its offset in flight."
    if wrong is None:
        bias = smoothed_acc_bias(case) if kind == "acc" else smoothed_gyro_bias(case)
        if bias is not None and bias.sure and a is case.log.replay_imu:
            sizes = [float(rotation.length(x[None])[0]) for x in (bias.mean, bias.mean + apart)]
            wrong, by = _larger_index(sizes, least), "its bias in flight"
    if wrong is None:
        return None, "Neither rest nor flight shows which one is off."
    return (a, b)[wrong], f"By {by} {(a, b)[wrong].acc.source} is off."


def _offset_found(case: HealthCase, a: Imu, b: Imu) -> Imu | None:
    """Return the one of two IMUs whose accelerometer the check of offsets accuses, None for none and for both."""
    accused = {check.sensor for check in case.found if check.question == "accelerometer_offset" and check.is_trouble}
    found = [imu for imu in (a, b) if imu.acc.source in accused]
    return found[0] if len(found) == 1 else None


def _larger_index(sizes: list[float], least: float, factor: float = LARGER_FACTOR) -> int | None:
    """Return the index of the clearly larger of two errors, None where neither is."""
    if len(sizes) < 2:
        return None
    k = int(np.argmax(sizes))
    return k if sizes[k] >= max(least, factor * sizes[1 - k]) else None


# Gyro bias and size of gravity against temperature, at rest. Block medians are averaged over bins of 1 K, so that each
# temperature has equal weight, and a line is fitted to the bins. The gyro uses all rests; the size of gravity only the
# rest with the widest span, because another place may be less level.

# Minimum temperature span for a slope.
SPAN_K, BIN_K, MIN_BINS = 5.0, 1.0, 4
# Significance: 4 sigma of 1.5 standard errors, because neighbouring bins are correlated.
SLOPE_SIGMAS, STANDARD_ERRORS = 4.0, 1.5
SLOPE_SOURCE = "limits of a bias at rest; the span is what the log holds at rest"
COLD_START_ADVICE = "Log from a cold start for ten minutes, standing still."


SPAN_TEXT = "over the span, fault above"
GYRO = Limits("gyro_temperature", "deg/s", 1.0, 3.0, f"ok up to 1 deg/s {SPAN_TEXT} 3", SLOPE_SOURCE)
ACC = Limits("accelerometer_temperature", "m/s^2", 0.3, 1.0, f"ok up to 0.3 m/s^2 {SPAN_TEXT} 1", SLOPE_SOURCE)


class TemperatureSlope(NamedTuple):
    """Line through bins of 1 K: ``slope`` per kelvin with its ``sigma`` (k,), from ``low`` to ``high`` degC."""

    slope: Array
    sigma: Array
    low: float
    high: float
    samples: int
    seconds: float

    @property
    def span(self) -> float:
        """Kelvin from the coldest bin to the warmest."""
        return self.high - self.low


def temperature_checks(case: HealthCase, limits: Limits) -> list[Check]:
    """Check the temperature slope of each IMU; one ``unknown`` where none is known."""
    units = usable_imus(case)
    if not units:
        return []
    spans = still_spans(case.segments)[0]
    found, widest = [], 0.0
    for imu in units:
        near = spans if limits is GYRO or not spans else [max(spans, key=lambda span: _reach_k(imu, [span]))]
        widest = max(widest, _reach_k(imu, near))
        line = fit_temperature(imu.gyro if limits is GYRO else force_size(imu.acc), imu.temperature, near)
        if line is not None:
            found.append(_slope_check(case, imu, limits, line))
    if found:
        return found
    why = f"At rest the temperature spans {widest:.1f} K; {SPAN_K:.0f} are needed, seen at several temperatures."
    if all(imu.temperature is None for imu in units):
        why = "The log holds no temperature of its inertial units."
    elif not spans:
        why = "The vehicle never stands still on the ground in this log."
    one = unknown(limits.question, why, limits.text, sensor=units[0].gyro.source, source=limits.source)
    one.action = COLD_START_ADVICE
    return [one]


gyro_temperature = partial(temperature_checks, limits=GYRO)
accelerometer_temperature = partial(temperature_checks, limits=ACC)


def fit_temperature(stream: Stream, temperature: Stream | None, spans: list[Span]) -> TemperatureSlope | None:
    """Fit a line over temperature to a stream at rest; None below 5 K or 4 bins."""
    values = stream_blocks(stream, spans)
    if temperature is None or values is None:
        return None
    t, celsius = finite_samples(temperature, spans)
    if len(t) < 2:
        return None
    at = np.interp(values.t, t, celsius[:, 0])
    bins = np.floor(at / BIN_K)
    numbers = unique(bins)
    warm = np.array([np.mean(at[bins == k]) for k in numbers])
    if len(numbers) < MIN_BINS or np.ptp(warm) < SPAN_K:
        return None
    mean = np.array([median(values.x[bins == k], axis=0) for k in numbers])
    around = warm - warm.mean()
    line = around @ (mean - mean.mean(axis=0)) / (around @ around)
    left = mean - mean.mean(axis=0) - np.outer(around, line)
    scatter = np.sqrt(np.sum(left**2, axis=0) / (len(numbers) - 2))
    sigma = STANDARD_ERRORS * scatter / np.sqrt(around @ around)
    return TemperatureSlope(line, sigma, float(warm.min()), float(warm.max()), values.samples, values.seconds)


def _reach_k(imu: Imu, spans: list[Span]) -> float:
    """Return the temperature range in K within spans."""
    if imu.temperature is None or not spans:
        return 0.0
    own = between(imu.temperature.t, spans[0][0], spans[-1][1])
    celsius = imu.temperature.x[own][inside(imu.temperature.t[own], spans), 0]
    celsius = celsius[np.isfinite(celsius)]
    return float(np.ptp(celsius)) if len(celsius) else 0.0


def _slope_check(case: HealthCase, imu: Imu, limits: Limits, line: TemperatureSlope) -> Check:
    factor = float(np.degrees(1.0)) if limits is GYRO else 1.0
    each, sigma = factor * line.slope, factor * line.sigma
    worst = int(np.argmax(np.abs(each)))
    size, unsure = float(each[worst]), float(sigma[worst])
    significant = abs(size) > SLOPE_SIGMAS * unsure
    verdict = graded(line.span * abs(size), limits.ok, limits.fault) if significant else "ok"
    source, about = (imu.gyro.source, f" about {'xyz'[worst]}") if limits is GYRO else (imu.acc.source, "")
    text = f"{source} changes by {size:+.3f} {limits.unit} per K{about} ({interval_text(size, unsure, 3)}, 95 %), "
    text += f"{line.low:.0f} to {line.high:.0f} degC."
    check = Check(limits.question, verdict, text, unit=f"{limits.unit}/K", threshold=limits.text, sensor=source)
    check.n, check.seconds, check.source = line.samples, round(line.seconds, 1), limits.source
    check.measure(size, unsure, 4)
    if limits is GYRO:
        check.measure_axes(each, sigma, 4)
    if verdict != "ok":
        check.why_no_setting = "A calibration over temperature measures it, a flight does not."
        check.action = case.log.remedy("temperature")
    return check
