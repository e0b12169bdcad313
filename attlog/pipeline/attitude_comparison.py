"""Compare an attitude of one's own with the reference of a log, or with another attitude: APE and RPE.

The statistics are those of evo (github.com/MichaelGrupp/evo) for rotations, on samples interpolated to common times:
absolute errors are the angles between both attitudes, relative ones the angles between their turns over an interval.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog import reference
from attlog.core import rotation
from attlog.core.brief import table_html, table_text
from attlog.core.errors import UsageError
from attlog.core.sorting import median, quantile
from attlog.estimators import Estimate
from attlog.estimators.unit_checks import TIME_UNITS, UnitWarning
from attlog.flight.model import Attitude, FlightLog
from attlog.metrics.metric import Case
from attlog.pipeline.preparation import prepare
from attlog.reference import alignment
from attlog.reference.model import AlignmentStep, AttitudeErrors, Reference, Scoring
from attlog.reference.scoring import attitude_errors, errors_against
from attlog.result import Result
from attlog.segments import model

if TYPE_CHECKING:
    import pandas

Array = NDArray[np.float64]
Align = Literal["auto", "none", "heading"]
# What an attitude is compared with: a log's reference, an attitude, or times (n,) and attitudes (n, 4).
Compared: TypeAlias = FlightLog | Case | Reference | Attitude | Path | str | tuple[ArrayLike, ArrayLike]
# Fewest common samples.
MIN_SAMPLES = 2
# Attitudes that are tried in other conventions.
MAX_TRIED = 2000
# Median error in deg above which other conventions of the quaternions are tried, and the share of it that one of them
# must leave to be named.
MAX_PLAIN_ERROR_DEG, MIN_SHARE = 10.0, 0.3


@dataclass(frozen=True, slots=True)
class ErrorStatistics:
    """Statistics of ``n`` errors, in deg, named as evo names them; ``p95`` is their 95 % quantile."""

    rmse: float
    mean: float
    median: float
    std: float
    min: float
    max: float
    p95: float
    n: int

    @classmethod
    def of(cls, errors: Array) -> ErrorStatistics:
        """Return the statistics of errors (n,), NaN without any."""
        if not len(errors):
            return cls(*(float("nan"),) * 7, 0)
        return cls(
            float(np.sqrt(np.mean(errors**2))),
            float(np.mean(errors)),
            float(median(errors)),
            float(np.std(errors)),
            float(np.min(errors)),
            float(np.max(errors)),
            float(quantile(errors, 0.95)),
            len(errors),
        )


@dataclass(slots=True)
class AttitudeComparison:
    """Errors of an attitude against a reference at common times.

    ``t`` (n,) s; ``total_deg``, ``tilt_deg`` and signed ``heading_deg`` (n,): the whole rotation between both, and its
    parts as in the metrics; ``q``, ``q_reference`` (n, 4). ``ape``: statistics of each angle's size by ``total``,
    ``tilt``, ``heading``. ``rpe``: of the difference between both turns over ``delta_s``. ``source``: the reference;
    ``caveat``: doubts about it. ``sigma_deg``: its own RMS error by angle where known. ``steps``: alignment.
    """

    source: str
    window: str
    delta_s: float
    t: Array
    total_deg: Array
    tilt_deg: Array
    heading_deg: Array
    q: Array
    q_reference: Array
    ape: dict[str, ErrorStatistics]
    rpe: ErrorStatistics
    steps: list[AlignmentStep] = field(default_factory=list)
    caveat: str = ""
    sigma_deg: dict[str, float] = field(default_factory=dict)

    def frame(self) -> pandas.DataFrame:
        """Return the errors by time in s: ``total_deg``, ``tilt_deg``, ``heading_deg``."""
        import pandas

        columns = {name: getattr(self, name) for name in ("total_deg", "tilt_deg", "heading_deg")}
        return pandas.DataFrame(columns, index=pandas.Index(self.t, name="time_s"))

    def __repr__(self) -> str:
        return table_text(*self._summary())

    def _repr_html_(self) -> str:
        return table_html(*self._summary())

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        """Return title and rows of the short text."""

        def words(s: ErrorStatistics) -> str:
            return f"RMSE {s.rmse:.3g}, median {s.median:.3g}, 95 % {s.p95:.3g}, max {s.max:.3g} deg, {s.n} samples"

        rows = [(f"APE {name}", words(one)) for name, one in self.ape.items()]
        rows.append((f"RPE {self.delta_s:g} s", words(self.rpe)))
        rows += [("aligned by", "; ".join(step.name for step in self.steps if step.applied) or "nothing")]
        if self.sigma_deg:
            rows.append(("reference", ", ".join(f"{name} +- {x:.2g} deg" for name, x in self.sigma_deg.items())))
        rows += [("caveat", self.caveat)] if self.caveat else []
        return f"AttitudeComparison with {self.source}, window {self.window}", rows


def compare_attitude(
    log_or_reference: Compared,
    t: ArrayLike,
    q: ArrayLike,
    *,
    align: Align = "auto",
    delta_s: float = 1.0,
    window: str = "all",
) -> AttitudeComparison:
    """Compare attitudes ``q`` (n, 4) at times ``t`` (n,) s with a log's reference or another attitude.

    ``log_or_reference``: a log, its path or a prepared log: the reference that ``analyze`` would take, its alignment
    (trim, scored time) and the log's clock; or an :class:`~attlog.Attitude` of a log, or a pair of times and
    attitudes. ``q``: scalar first, body FRD to earth NED, true north. The faster one is interpolated to the times of
    the slower, never across a gap.

    ``align``: ``heading`` removes the difference of heading at the start (of a pair: its mean), ``none`` does not,
    ``auto`` only where the reference knows no north. ``delta_s``: interval of the relative error, s. ``window``: as of
    :meth:`~attlog.Result.table`, or ``T0:T1`` in s; for a log only. UsageError for wrong shapes, for no common time,
    for a log without a reference. UnitWarning where another convention of the quaternions fits far better.
    """
    if align not in ("auto", "none", "heading"):
        raise UsageError(f"align={align!r}: use auto, none or heading")
    if not isinstance(delta_s, int | float | np.number) or not np.isfinite(delta_s) or delta_s <= 0.0:
        raise UsageError(f"delta_s={delta_s!r}: give a time in s above 0")
    if not isinstance(window, str):
        raise UsageError(f"window={window!r}: give a name as all or airborne, or T0:T1 in s, as a text")
    times, own = _samples(t, q)
    ref, case = _reference_of(log_or_reference)
    if case is None and window != "all":
        raise UsageError(f"window={window!r}: an attitude without its log has no windows but all; give the log")
    _check_overlap(times, ref, case)
    errors, steps = _errors(ref, case, times, own, align)
    use = errors.scored & np.isfinite(errors.total)
    if case is not None:
        try:
            use &= case.segments.mask(errors.t, window)
        except ValueError as error:
            raise UsageError(str(error)) from None
    if np.count_nonzero(use) < MIN_SAMPLES:
        where = f"{window}, scored from {ref.scoring.start:.1f} s on" if case is not None else window
        raise UsageError(f"{np.count_nonzero(use)} common samples in the window {where}: nothing to compare")
    _warn_of_convention(ref, times, own, any(step.name == "heading_offset" for step in steps))
    angles = {"total": errors.total[use], "tilt": errors.tilt[use], "heading": errors.heading[use]}
    sigmas = {a: reference.own_sigma_deg(ref, a) for a in ("tilt", "heading")} if case is not None else {}
    return AttitudeComparison(
        ref.source,
        window,
        delta_s,
        errors.t[use],
        angles["total"],
        angles["tilt"],
        angles["heading"],
        errors.q_est[use],
        errors.q_ref[use],
        {name: ErrorStatistics.of(np.abs(x)) for name, x in angles.items()},
        ErrorStatistics.of(relative_errors(errors, use, delta_s)),
        steps,
        reference.caveat(ref) if case is not None else "",
        {name: s for name, s in sigmas.items() if s is not None},
    )


def relative_errors(errors: AttitudeErrors, use: NDArray[np.bool_], delta_s: float) -> Array:
    """Return the angles (m,) in deg between both turns over ``delta_s``, of all pairs within a segment."""
    t, half = errors.t, 0.5 * float(median(np.diff(errors.t)))
    first = np.flatnonzero(use)
    last = np.clip(np.searchsorted(t, t[first] + delta_s - half), 0, len(t) - 1)
    whole = (np.abs(t[last] - t[first] - delta_s) <= half + 1e-9) & use[last] & (last > first)
    whole &= errors.segment[first] == errors.segment[last]
    a, b = first[whole], last[whole]
    turns = [rotation.multiply(rotation.conjugate(x[a]), x[b]) for x in (errors.q_ref, errors.q_est)]
    return np.degrees(rotation.total_angle(rotation.multiply(rotation.conjugate(turns[0]), turns[1])))


def _samples(t: ArrayLike, q: ArrayLike, what: str = "") -> tuple[Array, Array]:
    """Return finite, rising times (n,) and unit attitudes (n, 4). UsageError for other shapes."""
    try:
        times, own = np.asarray(t, np.float64), np.asarray(q, np.float64)
    except (TypeError, ValueError) as error:
        raise UsageError(f"{what}t and q must be arrays of numbers ({error})") from None
    if times.ndim != 1 or own.shape != (len(times), 4):
        hint = (
            "; attlog.rotation.from_euler(*angles.T) makes q from angles in rad" if own.shape == (len(times), 3) else ""
        )
        raise UsageError(f"{what}t must have shape (n,) and q (n, 4), not {times.shape} and {own.shape}{hint}")
    times, own = model.select_rising(times, rotation.normalize(own))
    if len(times) < MIN_SAMPLES:
        raise UsageError(f"{what}{len(times)} usable attitudes at rising times; {MIN_SAMPLES} are needed")
    return times, own


def _reference_of(given: Compared) -> tuple[Reference, Case | None]:
    """Return the reference to compare with, and the prepared log that it is of. UsageError without a reference."""
    if isinstance(given, FlightLog | Path | str):
        given = prepare(given)
    if isinstance(given, Case):
        if given.reference.kind == "none":
            why = "; ".join(s.text for s in given.reference.alignment.steps if s.name == "reference")
            raise UsageError(f"{given.log.path}: has no reference to compare with" + (f": {why}" if why else ""))
        return given.reference, given
    if isinstance(given, Reference):
        return given, None
    if isinstance(given, Result):
        raise UsageError("a result keeps no alignment of its reference; give the log, or attlog.prepare(log, ...)")
    if isinstance(given, Attitude):
        return _plain_reference(given.source, given.t if given.t_sample is None else given.t_sample, given.q), None
    if isinstance(given, Mapping) or not isinstance(given, tuple | list) or len(given) != 2:
        raise UsageError(f"compare_attitude takes a log, its path, an attitude or (t, q), not {type(given).__name__}")
    return _plain_reference("the attitude given", *given), None


def _plain_reference(source: str, t: ArrayLike, q: ArrayLike) -> Reference:
    """Return an attitude as reference, all of it scored."""
    times, own = _samples(t, q, "reference: ")
    segment = model.number_segments(times)
    rate = model.sample_rate(times)
    return Reference("truth", source, times, own, segment, segment, rate, scoring=Scoring(start=-np.inf))


def _check_overlap(t: Array, ref: Reference, case: Case | None) -> None:
    """Raise UsageError where attitude and reference share no time, with the clock or unit in which they do."""
    begin, end = float(ref.t[0]), float(ref.t[-1])
    if t[0] <= end and t[-1] >= begin:
        spans = float(t[-1] - t[0]), max(end - begin, 1e-9)
        unit = next((u for u, size in TIME_UNITS.items() if 0.5 < size * spans[0] / spans[1] < 2.0), "")
        if unit:
            text = f"t is taken in s and spans {spans[0]:.6g} s, the reference {spans[1]:.6g} s: it looks like {unit}"
            warnings.warn(f"{text}; give t * {TIME_UNITS[unit]:g}", UnitWarning, stacklevel=3)
        return
    boot = 0.0 if case is None else case.log.t0_us * 1e-6
    unix = None if case is None else case.log.utc_offset
    clocks = {"": 0.0, f" - {boot:.6f} (since boot)": boot} | ({} if unix is None else {f" - {unix:.3f} (Unix)": unix})
    factors = {"t": 1.0} | {f"t * {size:g}": size for size in TIME_UNITS.values()}
    fits = [
        factor + clock
        for factor, size in factors.items()
        for clock, shift in clocks.items()
        if size * t[0] - shift <= end and size * t[-1] - shift >= begin and size * (t[-1] - t[0]) > 0.1 * (end - begin)
    ]
    hint = f"; {fits[0]} does" if fits else ""
    clock = "" if case is None else ", the log's clock (0 at its first IMU sample)"
    raise UsageError(f"t from {t[0]:.6g} to {t[-1]:.6g} s has no time in {begin:.6g} to {end:.6g} s{clock}{hint}")


def _errors(
    ref: Reference, case: Case | None, t: Array, q: Array, align: Align
) -> tuple[AttitudeErrors, list[AlignmentStep]]:
    """Return the errors of an attitude, aligned as a row of an analysis, and the steps of the alignment."""
    segment = model.number_segments(t)
    if case is not None:
        estimate = Estimate(t, q, segment=segment)
        free = align == "heading"
        row = reference.replayed(case.log, case.segments, ref, estimate, name="own", uses_mag=not free)
        if align == "none" and row.heading_offset_deg is not None:
            turned = q if ref.alignment.trim is None else alignment.apply_trim(q, ref.alignment.trim)
            row.errors = errors_against(t, turned, segment, ref)
            row.steps = [step for step in row.steps if step.name != "heading_offset"]
        if row.errors is None:
            raise UsageError(row.reason or "nothing to compare")
        return row.errors, row.steps
    errors = errors_against(t, q, segment, ref)
    if align != "heading" or not len(errors.t):
        return errors, []
    along = np.radians(errors.heading)
    offset = float(np.arctan2(np.mean(np.sin(along)), np.mean(np.cos(along))))
    turned = rotation.turn_about_down(errors.q_est, -offset)
    step = AlignmentStep("heading_offset", "mean difference of heading, removed", float(np.degrees(offset)), "deg")
    rest = (errors.gap_segment, errors.segment, errors.scored)
    return attitude_errors(errors.t, turned, errors.q_ref, *rest), [step]


def _warn_of_convention(ref: Reference, t: Array, q: Array, any_heading: bool) -> None:
    """Issue a UnitWarning where another convention of the quaternions leaves far smaller errors.

    ``any_heading``: heading offsets do not count.
    """
    segment = model.number_segments(t)
    errors = errors_against(t, q, segment, ref)
    own = errors.q_est[:: max(1, len(errors.t) // MAX_TRIED)]
    wanted = errors.q_ref[:: max(1, len(errors.t) // MAX_TRIED)]
    plain = _median_error_deg(own, wanted, any_heading)
    if not plain > MAX_PLAIN_ERROR_DEG:
        return
    readings = {
        "scalar last; give q[:, [3, 0, 1, 2]]": own[:, [3, 0, 1, 2]],
        "earth to body; give rotation.conjugate(q)": rotation.conjugate(own),
        "ENU and FLU; give rotation.multiply(rotation.multiply(rotation.ENU, q), rotation.FLU)": rotation.multiply(
            rotation.multiply(rotation.ENU, own), rotation.FLU
        ),
    }
    found = {name: _median_error_deg(x, wanted, any_heading) for name, x in readings.items()}
    best = min(found, key=lambda name: found[name])
    if found[best] < MIN_SHARE * plain:
        text = f"q is taken scalar first, FRD to NED, and errs by {plain:.0f} deg (median): it looks like {best}"
        warnings.warn(text, UnitWarning, stacklevel=3)


def _median_error_deg(q: Array, ref: Array, any_heading: bool) -> float:
    """Return the median angle between attitudes, without their mean difference of heading if any heading will do."""
    e = rotation.earth_error(q, ref)
    if any_heading and len(e):
        along = rotation.heading_angle(e)
        offset = np.arctan2(np.mean(np.sin(along)), np.mean(np.cos(along)))
        e = rotation.earth_error(rotation.turn_about_down(q, -offset), ref)
    return float(np.degrees(median(rotation.total_angle(e)))) if len(e) else 0.0
