"""Metrics, their groups and answers, and the case that they evaluate."""

from __future__ import annotations

import functools
import weakref
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any, Concatenate, Literal, NamedTuple, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from attlog.core.brief import brief
from attlog.flight.model import FlightLog, Imu
from attlog.metrics.gyro_bias import CommonBias, common_bias, no_common_bias
from attlog.metrics.statistics import UnitValues
from attlog.reference.model import HeadingReference, Reference, Track
from attlog.segments.model import WINDOWS, Segments

Array = NDArray[np.float64]
T = TypeVar("T")
P = ParamSpec("P")

# Reasons for an answer without a value.
CODES = (
    "no_rest",
    "rest_too_short",
    "no_reference",
    "reference_too_slow",
    "reference_diverged",
    "no_events",
    "too_few_events",
    "no_magnetometer",
    "no_setpoint",
    "no_gnss",
    "not_converged",
    "diverged",
    "not_a_pure_delay",
    "not_covered",
    "clock_unknown",
    "not_applicable",
    "did_not_move",
    "lag_at_edge",
    "rate_too_low",
    "record_too_short",
    "too_uncertain",
    "part_failed",
)


@dataclass(frozen=True, slots=True)
class SpanAnswer:
    """Value of a metric over the span [t0, t1] s.

    ``usable_s`` s of it were used. ``value`` with ``ci95``, or None with the ``reason``.
    """

    t0: float
    t1: float
    usable_s: float
    value: float | None = None
    ci95: tuple[float, float] | None = None
    reason: str | None = None


@dataclass(slots=True)
class Answer:
    """Value of one metric for one row and window.

    With a value: ``n`` independent units of evidence over ``seconds`` and the 95 % interval ``ci95``. Without: ``code``
    (of CODES) and ``reason``. A value that is not ``ranked`` is never the best; ``reason`` then says why. In the
    value's own unit:

    - ``floor``: smallest difference that counts in a ranking
    - ``counts_as_zero_below``: smallest value that differs from zero
    - ``gyro_share``: noise floor of the gyro; variances that differ by less than its square are equal
    - ``coverage_pct``: share of the time that was compared, where it is below 95 %
    - ``each``: value of each event; ``records``: value of each span
    - ``disagree``: least and largest of the records where one value does not explain them all
    - ``taken_out``: known delay of the sensors that was subtracted
    - ``units``: evidence by which two answers on one log are paired
    """

    value: float | None = None
    unit: str = ""
    window: str = ""
    n: int = 0
    seconds: float = 0.0
    ci95: tuple[float, float] | None = None
    method: str = ""
    code: str | None = None
    reason: str | None = None
    ranked: bool = True
    floor: float = 0.0
    counts_as_zero_below: float = 0.0
    gyro_share: float = 0.0
    coverage_pct: float | None = None
    each: list[float] = field(default_factory=list)
    records: list[SpanAnswer] = field(default_factory=list)
    disagree: tuple[float, float] | None = None
    taken_out: float | None = None
    units: UnitValues | None = field(default=None, repr=False, compare=False)
    __repr__ = brief

    def __post_init__(self) -> None:
        if self.value is None:
            if self.code not in CODES or not self.reason:
                raise ValueError(f"an answer without value needs a code of CODES and a reason: {self.code!r}")
            self.ranked = False

    def copied(self, window: str) -> Answer:
        """Return the answer with lists of its own, as that of a window."""
        return replace(self, window=window, each=list(self.each), records=list(self.records))


def missing(code: str, reason: str, unit: str, window: str) -> Answer:
    """Return an answer without a value, with code and reason."""
    return Answer(None, unit, window, code=code, reason=reason)


class Resolution(NamedTuple):
    """Coarsest answer worth showing.

    An answer is withdrawn if its interval includes perfection and reaches farther than ``size`` from it, in the
    metric's unit. ``even``: that size in words ("a lag of 50 ms"). ``evidence``: what a longer log adds.
    """

    size: float
    even: str
    evidence: Literal["seconds", "steps", "windows"]


class Wording(NamedTuple):
    """Words of a comparison, as "A ``verb`` 24 % ``more`` than B".

    ``more`` is the better one; ``less`` the other. ``noun`` follows "in". Differences whose interval ends below
    ``none`` do not count.
    """

    verb: str
    more: str
    less: str
    noun: str
    none: float = 0.0


class Metric(NamedTuple):
    """Column of the table; ``definition`` is its paragraph in the report.

    ``name`` carries the unit (``noise_roll_deg``); ``better`` is the best value. ``decided_by``: the metric whose
    comparison of rows also applies to this one. ``wording`` None: made of the title. ``scale``: how two values are
    compared. ``asked``: windows in which ``compare`` uses it. ``covers``: whether an answer reports its coverage.
    """

    name: str
    title: str
    unit: str
    better: Literal["low", "zero", "one", "high"]
    definition: str
    decided_by: str = ""
    resolution: Resolution | None = None
    wording: Wording | None = None
    scale: Literal["ratio", "difference"] = "difference"
    asked: Literal["flight", "rest", "phases"] = "flight"
    covers: bool = False


class MetricGroup(NamedTuple):
    """Metrics that one function computes, with its requirements.

    Computed in ``windows`` and any ``T0:T1``, or in every window if ``windows`` is empty. Each of ``needs`` returns
    code and reason of what a case, row and window lack, or None. ``topic``: heading in a report. ``rests_on``: what the
    answers rest on; windows with equal evidence share them.
    """

    name: str
    topic: str
    metrics: tuple[Metric, ...]
    compute: Callable[[Case, Track, str], dict[str, Answer]]
    windows: tuple[str, ...] = ()
    needs: tuple[Callable[[Case, Track, str], tuple[str, str] | None], ...] = ()
    rests_on: Callable[[Case, Track, str], Hashable] | None = None

    def ask(self, case: Case, row: Track, window: str) -> dict[str, Answer]:
        """Return the answers for one row and window by metric."""
        if self.windows and window not in self.windows and ":" not in window:
            return {}
        for need in self.needs:
            absent = need(case, row, window)
            if absent is not None:
                return self.without(*absent, window)
        if self.rests_on is None:
            return self.compute(case, row, window)
        key, known = (self.name, self.rests_on(case, row, window)), case.of_row.setdefault(row, {})
        found = _remembered(known, key, lambda: self.compute(case, row, window))
        return {name: answer.copied(window) for name, answer in found.items()}

    def without(self, code: str, reason: str, window: str) -> dict[str, Answer]:
        """Return answers without a value for all metrics."""
        return {m.name: missing(code, reason, m.unit, window) for m in self.metrics}


@dataclass(slots=True)
class Case:
    """One log prepared for any filters; only ``rows`` depend on them.

    ``heading_references``: headings by name for drift in the air. ``imus``: IMUs to replay, by suffix of the filter's
    name. ``gyro_bias``: common bias by IMU index. ``settings``: resolved configuration as plain values. ``timing``:
    seconds by stage. ``rows``: those of one evaluation so far. ``undecided``: answers whose rank depends on later rows.
    ``of_log``, ``of_row``: caches of functions marked :func:`per_case` and :func:`per_row`.
    """

    log: FlightLog
    segments: Segments
    reference: Reference
    rows: list[Track] = field(default_factory=list)
    heading_references: dict[str, HeadingReference] = field(default_factory=dict)
    imus: dict[str, Imu] = field(default_factory=dict)
    gyro_bias: dict[int, CommonBias] = field(default_factory=dict)
    windows: tuple[str, ...] = WINDOWS
    settings: dict[str, Any] = field(default_factory=dict)
    timing: dict[str, float] = field(default_factory=dict)
    of_log: dict[Hashable, Any] = field(default_factory=dict, repr=False)
    of_row: WeakKeyDictionary[Track, dict[Hashable, Any]] = field(default_factory=WeakKeyDictionary, repr=False)
    undecided: list[tuple[Track, Answer]] = field(default_factory=list, repr=False)
    __repr__ = brief

    def bias_of(self, imu: Imu) -> CommonBias:
        """Return the common bias of an IMU.

        An IMU with modified samples has its own bias at rest.
        """
        known = self.gyro_bias.get(imu.index)
        if known is None or known.asked != "rest" or any(imu is own for own in self.log.imus):
            return known or no_common_bias()
        return common_bias(self.log, self.segments, imu, known.asked)

    def gyro_of(self, imu: Imu) -> Array:
        """Return an IMU's rates (n, 3) in rad/s without the common bias."""
        taken = self.bias_of(imu)
        return imu.gyro.x if taken.taken == "none" else imu.gyro.x - taken.at(imu.gyro.t_best)

    def with_rows(self, rows: list[Track]) -> Case:
        """Return the case with other rows, sharing the cache."""
        return replace(self, rows=rows, undecided=[])

    def compared_with(self, reference: Reference, heading_references: dict[str, HeadingReference]) -> Case:
        """Return the case with another reference and an empty cache."""
        return Case(
            self.log,
            self.segments,
            reference,
            heading_references=heading_references,
            imus=self.imus,
            gyro_bias=self.gyro_bias,
            windows=self.windows,
            settings=self.settings,
            timing=self.timing,
        )

    def done_with(self, row: Track) -> None:
        """Release the arrays of an evaluated row unless it is onboard."""
        if row.kind != "onboard":
            self.of_row.pop(row, None)
            row.release()

    def forget(self) -> None:
        """Clear the cache after a change to the log or to a row."""
        self.of_log.clear()
        self.of_row.clear()


def per_case(compute: Callable[Concatenate[Case, P], T]) -> Callable[Concatenate[Case, P], T]:
    """Cache a function of a case and of values such as spans.

    It must not read ``case.rows``.
    """

    @functools.wraps(compute)
    def cached(case: Case, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return _remembered(case.of_log, _key(compute, args, kwargs), lambda: compute(case, *args, **kwargs))

    return cached


def per_row(compute: Callable[Concatenate[Case, Track, P], T]) -> Callable[Concatenate[Case, Track, P], T]:
    """Cache a function of a case, a row, and plain values."""

    @functools.wraps(compute)
    def cached(case: Case, row: Track, /, *args: P.args, **kwargs: P.kwargs) -> T:
        known = case.of_row.setdefault(row, {})
        return _remembered(known, _key(compute, args, kwargs), lambda: compute(case, row, *args, **kwargs))

    return cached


def per_object(compute: Callable[Concatenate[Case, Any, P], T]) -> Callable[Concatenate[Case, Any, P], T]:
    """Cache a function of an array or IMU while that object lives.

    Replays of one IMU share the array of times. Neither the function nor its callers may hold or change the object.
    """

    @functools.wraps(compute)
    def cached(case: Case, shared: Any, /, *args: P.args, **kwargs: P.kwargs) -> T:
        key = (id(shared), _key(compute, args, kwargs))
        known = case.of_log.get(key)
        if known is None or known[0]() is not shared:
            of_log = case.of_log
            known = weakref.ref(shared, lambda _: of_log.pop(key, None)), compute(case, shared, *args, **kwargs)
            case.of_log[key] = known
        found: T = known[1]
        return found

    return cached


def _remembered(known: dict[Hashable, Any], key: Hashable, compute: Callable[[], T]) -> T:
    if key not in known:
        known[key] = compute()
    found: T = known[key]
    return found


def _key(compute: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Hashable:
    named = [x for pair in sorted(kwargs.items()) for x in pair] if kwargs else ()
    return (compute, *(x if type(x) is str else _frozen(x) for x in (*args, *named)))


def _frozen(value: Any) -> Hashable:
    """Return a hashable form of lists and slices."""
    if isinstance(value, list):
        return tuple(map(_frozen, value))
    key: Hashable = (slice, value.start, value.stop, value.step) if isinstance(value, slice) else value
    return key


def named(metrics: Iterable[Metric], name: str) -> Metric:
    """Return the metric or first variant of an id; KeyError for none."""
    some = [metric for metric in metrics if name in (metric.name, metric.name.partition(".")[0])]
    if not some:
        raise KeyError(name)
    return next((metric for metric in some if metric.name == name), some[0])


def paragraph(text: str) -> str:
    """Join the lines of a definition by single spaces."""
    return " ".join(text.split())
