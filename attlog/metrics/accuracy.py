"""How far is a row from the reference? RMSE, median, 95th percentile and maximum of the error angles."""

from __future__ import annotations

import math
from collections.abc import Collection
from functools import partial

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.spans import between, complement, intersect
from attlog.metrics import intervals as interval
from attlog.metrics.metric import (
    Answer,
    Case,
    Metric,
    Resolution,
    Wording,
    applies_to,
    missing,
    paragraph,
    per_case,
    per_row,
    per_times,
)
from attlog.metrics.statistics import (
    MIN_SAMPLES,
    PIECES,
    SHORTEST_S,
    STATISTICS,
    ErrorSize,
    Ids,
    Summary,
    UnitValues,
    make_ids,
)
from attlog.metrics.windows import (
    covered_seconds,
    imu_of,
    rest_spans,
    why_no_errors,
    why_no_heading,
    why_none,
    windows_of_times,
)
from attlog.reference import scoring, sigma_deg
from attlog.reference.model import Row
from attlog.segments import model

Array = NDArray[np.float64]


ANGLES = {
    "total": "the whole rotation between the row and the reference, 2 atan2(|e_vec|, |e0|)",
    "heading": "the part of the error about the vertical, 2 atan2(e3, e0), without its sign",
    "tilt": "the part of the error that tilts, 2 atan2(hypot(e1, e2), hypot(e0, e3))",
}
BLOCK_S = {"tilt": 5.0, "heading": 15.0, "total": 15.0}
"""Blocks in which rows are compared: from one to the next the difference of two rows in tilt keeps 0.26 of itself
after 5 s, in heading 0.48 (which made up to 7 % of the claims wrong), after 15 s next to nothing."""
MIN_BLOCKS = {"tilt": 4, "heading": 3, "total": 3}
BLOCK_FILLED = 0.8
_EVIDENCE = """Interval: what the next flight of that length would show, from the changes between halves and quarters
    (errors wander on every scale: more seconds do not average them out). Against a smoother it holds 2 sigma of the
    smoother's own error."""
_RANKED = """Rows are compared by the mean squares of their common blocks of 5 s (at least 4). Rows that gravity does
    not correct are not ranked: their error grows with the flight."""
_RANKED_HEADING = """Rows are compared by the mean squares of their common blocks of 15 s (at least 3), and only against
    truth or smoother: against the onboard attitude 13 to 30 % of significant pairs turned around in the remainder."""
NAMES = {"total": "attitude", "heading": "heading", "tilt": "tilt"}
"""What an error is called in a sentence."""
_EXTREME = "An extreme of this record is never ranked; its interval is the 2 sigma of a smoother's own error."
RMSE_METRICS: tuple[Metric, ...] = tuple(
    Metric(
        f"{angle}_{statistic}_deg",
        f"{angle.capitalize()} error, {words}",
        "deg",
        "low",
        ("reference",),
        paragraph(
            f"""{words[0].upper()}{words[1:]} of {meaning}, with e = q_est q_ref* seen in earth axes, over the scored
            samples of the window at the times of the slower of row and reference.
            {_EXTREME if statistic == "max" else _EVIDENCE}
            {_RANKED if angle == "tilt" else _RANKED_HEADING}"""
        ),
        "" if statistic == "rmse" else f"{angle}_rmse_deg",
        wording=Wording(f"holds {NAMES[angle]}", "closer", "less closely", f"{NAMES[angle]} error")
        if statistic == "rmse"
        else None,
        scale="ratio" if statistic == "rmse" else "difference",
        covers=True,
    )
    for angle, meaning in ANGLES.items()
    for statistic, words in STATISTICS.items()
)


def compute_rmse(case: Case, row: Row, window: str, only: Collection[str] | None = None) -> dict[str, Answer]:
    """Answers of METRICS for one row and window; ``only`` those of these ids, where many rows are asked for one."""
    errors = row.errors
    absent = why_no_errors(case, row)
    if absent is not None or errors is None:
        code, reason = absent or ("no_reference", "this row has no errors against the reference")
        return {m.name: missing(code, reason, "deg", window) for m in RMSE_METRICS}
    good = _scored(case, row) & in_window(case, errors.t, window)
    count = int(np.count_nonzero(good))
    if count < MIN_SAMPLES:
        start = case.reference.scoring_start
        reason = f"{count} scored samples are too few; {MIN_SAMPLES} are needed, from {start:.1f} s on"
        return {m.name: missing("not_covered", reason, "deg", window) for m in RMSE_METRICS}
    duration = covered_seconds(errors.t, model.segment_slices(good, _segments(case, row)))
    answers: dict[str, Answer] = {}
    for angle in ANGLES:
        asked = [name for name in STATISTICS if only is None or f"{angle}_{name}_deg" in only]
        if not asked:
            continue
        if angle != "tilt" and (why_not := why_no_heading(case, row)):
            answers |= {f"{angle}_{name}_deg": missing(*why_not, "deg", window) for name in asked}
            continue
        own = own_sigma(case, angle, window)
        size = ErrorSize(np.abs(getattr(errors, angle)[good]), duration, own)
        units = block_units(case, row, window, angle)
        for name in asked:
            value, ci95 = size.of(name)
            alone = why_unranked(case, row, angle, name, ci95, duration)
            why = alone or _among_others(case, row, angle) or _too_few(units, angle)
            answer = answers[f"{angle}_{name}_deg"] = Answer(
                value,
                "deg",
                window,
                size.pieces or 1,
                duration,
                ci95,
                f"{STATISTICS[name]}, {size.pieces} segments" if size.pieces else STATISTICS[name],
                reason=why,
                ranked=why is None,
                detail={"samples": count},
                floor=math.hypot(case.reference.floor_deg, own),
                units=units if name == "rmse" else None,
            )
            if alone is None and row.heading_offset_deg is not None and angle != "tilt":
                case.undecided.append((row, answer))
    return answers


def rank_errors(case: Case) -> None:
    """Settle, now that all rows are known, which headings whose offset was removed are ranked."""
    for row, answer in case.undecided:
        why = _among_others(case, row, "heading")
        if why is not None:
            answer.ranked, answer.reason = False, why


@per_case
def own_sigma(case: Case, angle: str, window: str) -> float:
    """How wrong the reference may be itself in a window, deg (one sigma); 0 for one that does not tell."""
    reference = case.reference
    if reference.sigma_tilt_deg is None:
        return 0.0
    inside = case.segments.mask(reference.t, window) & scoring.scored_mask(reference, reference.t)
    return float(np.nan_to_num(sigma_deg(reference, angle, inside)))


@per_times
def in_window(case: Case, t: Array, window: str) -> NDArray[np.bool_]:
    """Which of the times (n,) of errors lie in a window."""
    return case.segments.mask(t, window)


@per_row
def _scored(case: Case, row: Row) -> NDArray[np.bool_]:
    """Which of a row's errors (n,) count and are known."""
    assert row.errors is not None
    return row.errors.scored & np.isfinite(row.errors.total)


@per_row
def _segments(case: Case, row: Row) -> NDArray[np.int64]:
    """The segments (n,) of a row's errors between gaps and resets."""
    errors = row.errors
    assert errors is not None
    return model.merge_numbers(_number(case, errors.t), errors.segment)


@per_times
def _number(case: Case, t: Array) -> NDArray[np.int64]:
    return model.number_segments(t)


@per_row
def usual_step(case: Case, row: Row) -> float:
    """The median time between a row's errors, s."""
    assert row.errors is not None
    return _step(case, row.errors.t)


@per_times
def _step(case: Case, t: Array) -> float:
    return float(np.median(np.diff(t)))


def block_units(case: Case, row: Row, window: str, angle: str) -> UnitValues:
    """Mean squares (k,) of an error angle in blocks of the window's scored time, at the same times for all rows."""
    errors, length = row.errors, BLOCK_S[angle]
    begin, values = np.zeros(0), np.zeros(0)
    if errors is not None and len(errors.t) > 1:
        needed = BLOCK_FILLED * length / usual_step(case, row)
        begin, first, last = _error_blocks(case, errors.t, window, length)
        total, count = (interval.group_sums(x, first, last) for x in _block_squares(case, row, angle))
        full = count >= max(needed, 2)
        begin, values = begin[full], total[full] / count[full]
    chosen = make_ids(begin)
    sigma = own_sigma(case, angle, window)
    return UnitValues("mean_square", chosen, values, partial(of_blocks, chosen, values, length=length, sigma=sigma))


@per_times
def _error_blocks(
    case: Case, t: Array, window: str, length: float
) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """When the blocks of a window's scored time begin (k,), and which of the times (n,) are in each: first, and end."""
    scored = complement(case.reference.unscored, case.reference.scoring_start, case.reference.end)
    spans = intersect(case.segments.spans(window), scored)
    starts = [t0 + length * np.arange(int((t1 - t0) // length)) for t0, t1 in spans]
    begin = np.concatenate([np.zeros(0), *starts])
    return begin, np.searchsorted(t, begin), np.searchsorted(t, begin + length)


@per_row
def _block_squares(case: Case, row: Row, angle: str) -> tuple[Array, Array]:
    """The squares (n,) of an error angle, 0 where it does not count, and which count, as numbers (n,)."""
    return np.where(_scored(case, row), getattr(row.errors, angle) ** 2, 0.0), _counted(case, row)


@per_row
def _counted(case: Case, row: Row) -> Array:
    """The same for all angles: in long logs copies add up."""
    return _scored(case, row).astype(np.float64)


def of_blocks(ids: Ids, squares: Array, wanted: Ids, length: float = BLOCK_S["tilt"], sigma: float = 0.0) -> Summary:
    """The RMSE of some of the blocks (k,) of ``length`` s, with its interval against a reference of that sigma, deg.

    A block counts as several samples: quarters of a record may cut through it.
    """
    chosen = squares[np.isin(ids, wanted)]
    return Summary(*ErrorSize(np.repeat(np.sqrt(chosen), PIECES), length * len(chosen), sigma).of("rmse"))


def why_unranked(
    case: Case, row: Row, angle: str, name: str, ci95: interval.Interval | None, duration: float
) -> str | None:
    """Why an error is shown but not ranked, whatever the other rows are, else None."""
    if name == "max":
        return "an extreme of this record has no interval"
    if ci95 is None:
        return f"{duration:.1f} s are too short for an interval; {SHORTEST_S:.0f} s are needed"
    if angle != "tilt" and (case.reference.kind == "onboard" or case.reference.heading_by == "onboard"):
        return "compared with the onboard attitude, whose own heading error can be larger"
    if case.reference.kind == row.estimator:
        return "made the same way as the reference"
    return None


def _among_others(case: Case, row: Row, angle: str) -> str | None:
    """A reason not to rank heading errors: the offset of this row was removed while others had to find theirs."""
    if angle == "tilt" or row.heading_offset_deg is None:
        return None
    if all(r.heading_offset_deg is not None for r in case.rows if r.kind == "replay"):
        return None
    return "its heading offset was removed (it has no north of its own), the others had to find theirs"


def _too_few(units: UnitValues, angle: str) -> str | None:
    """A reason not to rank errors of so few blocks."""
    if len(units.ids) >= MIN_BLOCKS[angle]:
        return None
    needed = MIN_BLOCKS[angle] * BLOCK_S[angle]
    have = f"{len(units.ids)} whole block{'' if len(units.ids) == 1 else 's'} of {BLOCK_S[angle]:.0f} s"
    return f"too short to rank: {have}; {needed:.0f} s are needed"


# Is the filter's own gyro bias right? Its estimate against the mean rate of the gyro at rest.

BIAS_METRICS: tuple[Metric, ...] = (
    Metric(
        "gyro_bias_error_dps",
        "Gyro bias error",
        "deg/s",
        "low",
        ("rest",),
        paragraph(
            """Length of the difference between the gyro bias that the filter subtracts (its own estimate, and what is
            subtracted for every filter alike: `--gyro-bias`) and the mean rate that the logged gyro
            shows at rest, averaged over windows of 5 s (one window where the rest is shorter) once the filter has
            settled. Interval: t over the windows. The rate at rest contains the earth's turn (0.004 deg/s)."""
        ),
        resolution=Resolution(1.0, "1 deg/s", "windows"),
        asked="rest",
    ),
)


def bias_window_errors(t: Array, gyro: Array, row: Row, windows: list[slice]) -> Array:
    """Bias estimate minus mean gyro (k, 3) in deg/s for windows of gyro samples that have an estimate."""
    found = []
    for w in windows:
        inside = between(row.t, t[w.start], t[w.stop - 1])
        if row.bias is not None and inside.stop > inside.start and np.isfinite(row.bias[inside]).all():
            found.append(np.degrees(_mean(row.bias[inside]) - _mean(gyro[w])))
    return np.array(found).reshape(-1, 3)


def _mean(x: Array) -> Array:
    """The mean (k,) of rows (n, k), column by column: many times faster than along a short last axis."""
    return np.array([float(column.sum()) / len(column) for column in x.T])


def compute_bias(case: Case, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for one row and window; nothing for windows without rest by definition."""
    if not applies_to(window, "all", "rest", "rest.long"):
        return {}
    name, unit = "gyro_bias_error_dps", "deg/s"
    imu = imu_of(case, row)
    if row.kind != "replay" or row.bias is None or imu is None or not (row.estimates_bias and np.any(row.bias)):
        reason = "this row has no gyro bias estimate of the replayed gyro"
        return {name: missing("not_applicable", reason, unit, window)}
    gyro = imu.gyro
    laid = [w for span in rest_spans(case, row, window) for _, w in windows_of_times(case, gyro.t, "rest", span)]
    windows = [w for w in laid if w is not None and rotation.finite_rows(gyro.x[w]).all()]
    errors = bias_window_errors(gyro.t, gyro.x, row, windows)
    if len(errors) == 0:
        return {name: missing(*why_none(case, "rest", window), unit, window)}
    lengths = np.sqrt(np.sum(errors**2, axis=1))
    few = None if len(errors) > 1 else "one window of rest gives no interval"
    return {
        name: Answer(
            float(np.mean(lengths)),
            unit,
            window,
            len(errors),
            covered_seconds(gyro.t, windows),
            interval.mean_interval(lengths),
            f"mean over {len(errors)} windows",
            reason=few,
            ranked=few is None,
            detail={"mean_error_dps": [float(x) for x in np.mean(errors, axis=0)]},
        )
    }
