"""An answer: a number with its evidence, or a code and a sentence that says what is missing."""

from __future__ import annotations

import functools
import weakref
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any, Concatenate, Literal, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from attlog.flight.model import FlightLog, Imu
from attlog.metrics.gyro_bias import CommonBias, common_bias, no_common_bias
from attlog.metrics.statistics import UnitValues
from attlog.reference.model import HeadingReference, Reference, Row
from attlog.segments.model import WINDOWS, Segments

__all__ = [
    "Case",
    "HeadingReference",
    "Metric",
    "Resolution",
    "Wording",
    "applies_to",
    "named",
    "paragraph",
    "per_case",
    "per_row",
    "per_times",
]


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
    """One span of time that a question was put to: [t0, t1] s, how much of it could be used, and what it says.

    ``value`` with ``ci95``, or None and the ``reason``, which says what would be needed.
    """

    t0: float
    t1: float
    usable_s: float
    value: float | None = None
    ci95: tuple[float, float] | None = None
    reason: str | None = None


@dataclass(slots=True)
class Answer:
    """The value of one metric for one row and window.

    With a value: ``n`` independent units of evidence over ``seconds``, ``ci95`` the
    95 % interval. Without: ``code`` (of CODES) and ``reason``. ``ranked`` is False where
    the value is shown but may not be "best"; ``reason`` then says why. ``detail`` holds
    more for people (slopes, flags); nothing is computed from it. In the value's own unit:

    - ``floor``: the difference below which two values are the same, for the ranking
    - ``counts_as_zero_below``: a smaller value is no different from zero
    - ``gyro_share``: what the gyro itself wanders by, of noise that is added to it; variances that differ by less
      than its square are the same
    - ``coverage_pct``: the share of the time that a comparison stands on where that is not nearly all
    - ``each``: the value of every single event; ``records``: each span of time on its own
    - ``disagree``: least and largest of the records where one value does not explain them all
    - ``changes``: first and last rate where the rate itself rises or falls steadily
    - ``taken_out``: what was subtracted because it is not the row's own (the delay of the logged sensors)
    - ``units``: the evidence by which the answer is paired with another on the same log
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
    detail: dict[str, Any] = field(default_factory=dict)
    floor: float = 0.0
    counts_as_zero_below: float = 0.0
    gyro_share: float = 0.0
    coverage_pct: float | None = None
    each: list[float] = field(default_factory=list)
    records: list[SpanAnswer] = field(default_factory=list)
    disagree: tuple[float, float] | None = None
    changes: tuple[float, float] | None = None
    taken_out: float | None = None
    units: UnitValues | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.value is None:
            if self.code not in CODES or not self.reason:
                raise ValueError(
                    f"an absent value needs a code of CODES and a reason, got {self.code!r}, {self.reason!r}"
                )
            self.ranked = False


def missing(code: str, reason: str, unit: str, window: str, **detail: Any) -> Answer:
    """An answer without a value: why, and what would be needed."""
    return Answer(None, unit, window, code=code, reason=reason, detail=detail)


# What a metric is, and what it may look at.

Array = NDArray[np.float64]
T = TypeVar("T")
P = ParamSpec("P")


@dataclass(frozen=True, slots=True)
class Resolution:
    """The coarsest answer that says anything: an interval that holds perfection and reaches farther is withheld.

    ``size`` is the distance from perfection that is known without any log, in the metric's unit; ``even`` says in
    words what is then not shown ("a lag of 50 ms"); ``evidence`` is what more of would help.
    """

    size: float
    even: str
    evidence: Literal["seconds", "steps", "windows"]


@dataclass(frozen=True, slots=True)
class Wording:
    """How a comparison says a metric: "A ``verb`` 24 % ``more`` than B", or ``less``; ``noun`` stands after "in".

    ``more`` is said of the better one. ``none``: a difference whose interval ends below it is no difference.
    """

    verb: str
    more: str
    less: str
    noun: str
    none: float = 0.0


@dataclass(frozen=True, slots=True)
class Metric:
    """A column of the table, and all that others say or decide about it. ``definition`` is the report's paragraph.

    ``name`` carries the unit (``noise_roll_deg``); ``better`` says which value is best;
    ``needs`` names what must be in the log (rest, reference, events, mag, gnss, setpoint).
    ``decided_by`` is the metric whose comparison of rows holds for this one too. ``resolution``: what its
    answers must resolve, None where any answer describes the flight. ``wording``: its words in a comparison, else
    made of the title. ``scale``: how two values are compared. ``asked``: where ``compare`` asks it: in flight, at
    rest, or in each phase for itself. ``covers``: whether an answer tells the share of the time it was compared on.
    """

    name: str
    title: str
    unit: str
    better: Literal["low", "zero", "one", "high"]
    needs: tuple[str, ...]
    definition: str
    decided_by: str = ""
    resolution: Resolution | None = None
    wording: Wording | None = None
    scale: Literal["ratio", "difference"] = "difference"
    asked: Literal["flight", "rest", "phases"] = "flight"
    covers: bool = False


@dataclass(slots=True)
class Case:
    """One log made ready for any set of filters: nothing in it but ``rows`` depends on a filter.

    ``heading_references``: headings by name for drift in the air. ``imus``: the units to
    replay, by what their rows are called after the filter's name ("" for the only one).
    ``gyro_bias``: what is subtracted from their gyros before any filter runs, by index of the unit.
    ``windows``: those to answer for. ``settings``: the resolved configuration as plain
    values, for the result. ``timing``: seconds by stage of making it ready. ``rows``
    are those of one evaluation that have passed, the one that is asked about included.
    """

    log: FlightLog
    segments: Segments
    reference: Reference
    rows: list[Row] = field(default_factory=list)
    heading_references: dict[str, HeadingReference] = field(default_factory=dict)
    imus: dict[str, Imu] = field(default_factory=dict)
    gyro_bias: dict[int, CommonBias] = field(default_factory=dict)
    windows: tuple[str, ...] = WINDOWS
    settings: dict[str, Any] = field(default_factory=dict)
    timing: dict[str, float] = field(default_factory=dict)
    of_log: dict[Hashable, Any] = field(default_factory=dict, repr=False)
    """What functions marked :func:`per_case` have found."""
    of_row: WeakKeyDictionary[Row, dict[Hashable, Any]] = field(default_factory=WeakKeyDictionary, repr=False)
    """What functions marked :func:`per_row` have found, kept as long as the row lives."""
    undecided: list[tuple[Row, Answer]] = field(default_factory=list, repr=False)
    """Answers whose rank depends on rows that may pass later."""

    def bias_of(self, imu: Imu) -> CommonBias:
        """What is subtracted from the gyro of a unit before any filter runs; of changed samples of a unit their own."""
        known = self.gyro_bias.get(imu.index)
        if known is None or known.asked != "rest" or any(imu is own for own in self.log.imus):
            return known or no_common_bias()
        return common_bias(self.log, self.segments, imu, known.asked)

    def gyro_of(self, imu: Imu) -> Array:
        """The rates (n, 3) in rad/s of a unit as filters get them: without the common bias."""
        taken = self.bias_of(imu)
        return imu.gyro.x if taken.taken == "none" else imu.gyro.x - taken.at(imu.gyro.t_best)

    def looked_at_with(self, rows: list[Row]) -> Case:
        """The same case with the rows of one evaluation; what was found of the log is shared, not computed again."""
        return replace(self, rows=rows, undecided=[])

    def compared_with(self, reference: Reference, heading_references: dict[str, HeadingReference]) -> Case:
        """The same case with another reference; nothing computed with the first is kept."""
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

    def done_with(self, row: Row) -> None:
        """Release what a replayed row holds for each sample: in a long log the rows are larger than the log."""
        if row.kind == "replay":
            self.of_row.pop(row, None)
            row.release()

    def forget(self) -> None:
        """Drop what was computed, after a change to the log or to a row."""
        self.of_log.clear()
        self.of_row.clear()


def per_case(compute: Callable[Concatenate[Case, P], T]) -> Callable[Concatenate[Case, P], T]:
    """A function of a case (and of values such as spans) that is computed once for each of them.

    For what rows, windows or metrics share; it must not look at ``case.rows``.
    """

    @functools.wraps(compute)
    def shared(case: Case, /, *args: P.args, **kwargs: P.kwargs) -> T:
        key = (compute, *map(_frozen, args), *((name, _frozen(kwargs[name])) for name in sorted(kwargs)))
        if key not in case.of_log:
            case.of_log[key] = compute(case, *args, **kwargs)
        found: T = case.of_log[key]
        return found

    return shared


def per_row(compute: Callable[Concatenate[Case, Row, P], T]) -> Callable[Concatenate[Case, Row, P], T]:
    """A function of a case and one of its rows (and of values such as spans) that is computed once for each."""

    @functools.wraps(compute)
    def shared(case: Case, row: Row, /, *args: P.args, **kwargs: P.kwargs) -> T:
        known = case.of_row.setdefault(row, {})
        key = (compute, *map(_frozen, args), *((name, _frozen(kwargs[name])) for name in sorted(kwargs)))
        if key not in known:
            known[key] = compute(case, row, *args, **kwargs)
        found: T = known[key]
        return found

    return shared


def per_times(compute: Callable[Concatenate[Case, Any, P], T]) -> Callable[Concatenate[Case, Any, P], T]:
    """A function of a case and an array (and of values such as windows) that is computed once for each array object.

    For what rows share that have the same times: replays of one unit share the array. It is kept as long as the array
    lives, and must not hold it; nobody may write into the array.
    """

    @functools.wraps(compute)
    def shared(case: Case, array: Any, /, *args: P.args, **kwargs: P.kwargs) -> T:
        key = (compute, id(array), *map(_frozen, args), *((name, _frozen(kwargs[name])) for name in sorted(kwargs)))
        known = case.of_log.get(key)
        if known is None or known[0]() is not array:
            of_log = case.of_log
            known = weakref.ref(array, lambda _: of_log.pop(key, None)), compute(case, array, *args, **kwargs)
            case.of_log[key] = known
        found: T = known[1]
        return found

    return shared


def _frozen(value: Any) -> Hashable:
    """A value as part of a key: lists become tuples, slices their bounds; anything else must be hashable itself."""
    if isinstance(value, list):
        return tuple(map(_frozen, value))
    if isinstance(value, slice):
        return (slice, value.start, value.stop, value.step)
    key: Hashable = value
    return key


def named(metrics: Iterable[Metric], name: str) -> Metric:
    """The metric of an id; for an id without its variant after the dot (``drift_air_deg_per_min``) the first of them.

    KeyError for an id that none has.
    """
    some = [metric for metric in metrics if name in (metric.name, metric.name.partition(".")[0])]
    if not some:
        raise KeyError(name)
    return next((metric for metric in some if metric.name == name), some[0])


def applies_to(window: str, *names: str) -> bool:
    """Whether a metric that belongs to the named windows says something about this one (``T0:T1`` always)."""
    return ":" in window or window in names


def paragraph(text: str) -> str:
    """The text with its line breaks and indents as single spaces, for definitions written over several lines."""
    return " ".join(text.split())
