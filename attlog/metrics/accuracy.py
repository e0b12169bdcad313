"""Errors of a row against the reference, and coverage of the log."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from attlog.core.sorting import is_in
from attlog.core.spans import complement, intersect
from attlog.metrics import statistics
from attlog.metrics.metric import Answer, Case, Metric, MetricGroup, Wording, paragraph, per_case, per_object, per_row
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
from attlog.metrics.step_fit import timing
from attlog.metrics.windows import covered_seconds, why_no_errors, why_no_heading, why_unproven
from attlog.reference import scoring, sigma_deg
from attlog.reference.model import Track
from attlog.segments import model

Array = NDArray[np.float64]


ANGLES = {
    "total": "the whole rotation between the row and the reference, 2 atan2(|e_vec|, |e0|)",
    "heading": "the part of the error about the vertical, 2 atan2(e3, e0), without its sign",
    "tilt": "the part of the error that tilts, 2 atan2(hypot(e1, e2), hypot(e0, e3))",
}
# Length of the blocks in which rows are compared. The difference of two rows correlates from block to block by 0.26
# after 5 s in tilt, by 0.48 in heading (which made up to 7 % of the claims wrong), and hardly after 15 s.
BLOCK_S = {"tilt": 5.0, "heading": 15.0, "total": 15.0}
MIN_BLOCKS = {"tilt": 4, "heading": 3, "total": 3}
BLOCK_FILLED = 0.8  # share of a block that must be scored
_EVIDENCE = """Interval: what the next flight of that length would show, from the changes between halves and quarters
    (errors wander on every scale: more seconds do not average them out). Against a smoother it holds 2 sigma of the
    smoother's own error. The white noise of a truth by --truth is taken out of RMS errors."""
_RANKED = """Rows are compared by the mean squares of their common blocks of 5 s (at least 4). Rows that gravity does
    not correct are not ranked: their error grows with the flight. No row is ranked against an onboard attitude where
    the smoother, which could have confirmed it, was refused."""
_RANKED_HEADING = """Rows are compared by the mean squares of their common blocks of 15 s (at least 3), and only against
    truth or smoother: against the onboard attitude 13 to 30 % of significant pairs turned around in the remainder."""
# Names of the errors in sentences.
NAMES = {"total": "attitude", "heading": "heading", "tilt": "tilt"}


def _metric(angle: str, statistic: str) -> Metric:
    """Return the metric of one of ANGLES and one of STATISTICS."""
    words, rmse = STATISTICS[statistic], statistic == "rmse"
    return Metric(
        f"{angle}_{statistic}_deg",
        f"{angle.capitalize()} error, {words}",
        "deg",
        "low",
        paragraph(
            f"""{words[0].upper()}{words[1:]} of {ANGLES[angle]}, with e = q_est q_ref* seen in earth axes, over the
            scored samples of the window at the times of the slower of row and reference. {_EVIDENCE}
            {_RANKED if angle == "tilt" else _RANKED_HEADING}"""
        ),
        "" if rmse else f"{angle}_rmse_deg",
        wording=Wording(f"holds {NAMES[angle]}", "closer", "less closely", f"{NAMES[angle]} error") if rmse else None,
        scale="ratio" if rmse else "difference",
        covers=True,
    )


def compute_errors(angle: str, case: Case, row: Track, window: str) -> dict[str, Answer]:
    """Return the error statistics of one of ANGLES in a window."""
    group, errors = ERRORS[angle], row.errors
    assert errors is not None
    good, count, duration = _scored_in(case, row, window)
    if count < MIN_SAMPLES:
        start = case.reference.scoring.start
        reason = f"{count} scored samples are too few; {MIN_SAMPLES} are needed, from {start:.1f} s on"
        return group.without("not_covered", reason, window)
    own = own_sigma(case, angle, window)
    size = ErrorSize(np.abs(getattr(errors, angle)[good]), duration, own, white_noise(case, angle))
    units = block_units(case, row, window, angle)
    answers: dict[str, Answer] = {}
    for metric in group.metrics:
        statistic = metric.name.split("_")[1]
        value, ci95 = size.of(statistic)
        alone = why_unranked(case, row, angle, ci95, duration)
        why = alone or _among_others(case, row, angle) or _too_few(units, angle) or why_unproven(case)
        answer = answers[metric.name] = Answer(
            value,
            "deg",
            window,
            size.pieces or 1,
            duration,
            ci95,
            f"{STATISTICS[statistic]}, {size.pieces} segments" if size.pieces else STATISTICS[statistic],
            reason=why,
            ranked=why is None,
            floor=math.hypot(case.reference.alignment.floor_deg, own),
            units=units if statistic == "rmse" else None,
        )
        if alone is None and row.heading_offset_deg is not None and angle != "tilt":
            case.undecided.append((row, answer))
    return answers


def rank_errors(case: Case) -> None:
    """Decide which heading errors without offset are ranked."""
    for row, answer in case.undecided:
        why = _among_others(case, row, "heading")
        if why is not None:
            answer.ranked, answer.reason = False, why


@per_case
def own_sigma(case: Case, angle: str, window: str) -> float:
    """Return the reference's RMS sigma in a window, deg; 0 if unknown."""
    reference = case.reference
    if reference.sigma is None:
        return 0.0
    inside = case.segments.mask(reference.t, window) & scoring.scored_mask(reference, reference.t)
    return float(np.nan_to_num(sigma_deg(reference, angle, inside)))


def white_noise(case: Case, angle: str) -> float:
    """Return the white noise of an external truth, deg; 0 of any other reference."""
    fit = case.reference.fit
    if fit is None:
        return 0.0
    heading = fit.noise_heading_deg if case.reference.heading.by in ("own", "relative") else 0.0
    return {"tilt": fit.noise_tilt_deg, "heading": heading, "total": math.hypot(fit.noise_tilt_deg, heading)}[angle]


@per_object
def in_window(case: Case, t: Array, window: str) -> NDArray[np.bool_]:
    """Return which times (n,) of errors lie in a window."""
    return case.segments.mask(t, window)


@per_row
def _scored(case: Case, row: Track) -> NDArray[np.bool_]:
    """Return which of a row's errors (n,) are scored and finite."""
    assert row.errors is not None
    return row.errors.scored & np.isfinite(row.errors.total)


@per_row
def _scored_in(case: Case, row: Track, window: str) -> tuple[NDArray[np.bool_], int, float]:
    """Return which of a row's errors (n,) are scored in a window, their number and the seconds that they cover."""
    assert row.errors is not None
    good = _scored(case, row) & in_window(case, row.errors.t, window)
    seconds = covered_seconds(row.errors.t, model.segment_slices(good, _segments(case, row)))
    return good, int(np.count_nonzero(good)), seconds


@per_row
def _segments(case: Case, row: Track) -> NDArray[np.int64]:
    """Return the segments (n,) of a row's errors between gaps and resets."""
    errors = row.errors
    assert errors is not None
    return model.merge_numbers(timing(case, errors.t).number, errors.segment)


def block_units(case: Case, row: Track, window: str, angle: str) -> UnitValues:
    """Return mean squares (k,) of an error angle in blocks."""
    errors, length = row.errors, BLOCK_S[angle]
    begin, values = np.zeros(0), np.zeros(0)
    if errors is not None and len(errors.t) > 1:
        needed = BLOCK_FILLED * length / timing(case, errors.t).step
        begin, first, last = _error_blocks(case, errors.t, window, length)
        total = statistics.group_sums(_block_squares(case, row, angle), first, last)
        count = _block_counts(case, row, window, length)
        full = count >= max(needed, 2)
        begin, values = begin[full], np.maximum(total[full] / count[full] - white_noise(case, angle) ** 2, 0.0)
    chosen = make_ids(begin)
    sigma = own_sigma(case, angle, window)
    return UnitValues(
        "mean_square", chosen, values, partial(rmse_of_blocks, chosen, values, length=length, sigma=sigma)
    )


@per_object
def _error_blocks(
    case: Case, t: Array, window: str, length: float
) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Return the starts (k,) of the blocks of a window."""
    scored = complement(case.reference.scoring.unscored, case.reference.scoring.start, case.reference.scoring.end)
    spans = intersect(case.segments.spans(window), scored)
    starts = [t0 + length * np.arange(int((t1 - t0) // length)) for t0, t1 in spans]
    begin = np.concatenate([np.zeros(0), *starts])
    return begin, np.searchsorted(t, begin), np.searchsorted(t, begin + length)


@per_row
def _block_squares(case: Case, row: Track, angle: str) -> Array:
    """Return squares (n,) of an error angle, 0 where not scored."""
    return np.where(_scored(case, row), getattr(row.errors, angle) ** 2, 0.0)


@per_row
def _block_counts(case: Case, row: Track, window: str, length: float) -> Array:
    """Return the number of scored samples (k,) in each block of a window."""
    assert row.errors is not None
    _, first, last = _error_blocks(case, row.errors.t, window, length)
    return statistics.group_sums(_scored(case, row).astype(np.float64), first, last)


def rmse_of_blocks(ids: Ids, squares: Array, wanted: Ids, length: float, sigma: float) -> Summary:
    """Return the RMSE over the blocks ``wanted`` with its interval.

    ``squares`` (k,) of blocks ``ids`` (k,), ``length`` s each; ``sigma`` of the reference, deg. Each block counts as
    several samples, as quarters of a record may cut through it.
    """
    chosen = squares[is_in(ids, wanted)]
    return Summary(*ErrorSize(np.repeat(np.sqrt(chosen), PIECES), length * len(chosen), sigma).of("rmse"))


def why_unranked(case: Case, row: Track, angle: str, ci95: statistics.Interval | None, duration: float) -> str | None:
    """Return why an error is unranked whatever the other rows; else None."""
    if ci95 is None:
        return f"{duration:.1f} s are too short for an interval; {SHORTEST_S:.0f} s are needed"
    if angle != "tilt" and (case.reference.kind == "onboard" or case.reference.heading.by == "onboard"):
        return "compared with the onboard attitude, whose own heading error can be larger"
    if case.reference.kind == row.estimator:
        return "made the same way as the reference"
    return None


def _among_others(case: Case, row: Track, angle: str) -> str | None:
    """Return why a heading without offset is not ranked, else None."""
    if angle == "tilt" or row.heading_offset_deg is None:
        return None
    if all(r.heading_offset_deg is not None for r in case.rows if r.kind == "replay"):
        return None
    return "its heading offset was removed (it has no north of its own), the others had to find theirs"


def _too_few(units: UnitValues, angle: str) -> str | None:
    """Return why errors of too few blocks are not ranked, else None."""
    if len(units.ids) >= MIN_BLOCKS[angle]:
        return None
    needed = MIN_BLOCKS[angle] * BLOCK_S[angle]
    have = f"{len(units.ids)} whole block{'' if len(units.ids) == 1 else 's'} of {BLOCK_S[angle]:.0f} s"
    return f"too short to rank: {have}; {needed:.0f} s are needed"


COVERAGE_METRIC = Metric(
    "coverage_pct",
    "Coverage",
    "%",
    "high",
    "Share of the time in the air and at rest, after the scoring start, in which this row was compared.",
)


def compute_coverage(case: Case, row: Track, window: str) -> dict[str, Answer]:
    """Return the compared share of the log; empty unless ``window`` is all."""
    if window != "all":
        return {}
    absent = why_no_errors(case, row)
    if absent is None and row.coverage_pct is None:
        absent = "not_covered", "neither flight nor rest after the scoring start"
    if absent is not None:
        return COVERAGE.without(*absent, window)
    assert row.errors is not None
    return {
        "coverage_pct": Answer(
            row.coverage_pct,
            "%",
            window,
            len(row.errors.t),
            float(row.errors.t[-1] - row.errors.t[0]),
            None,
            "scored over all time in air and at rest",
            reason="a property of the comparison",
            ranked=False,
        )
    }


STATISTICS_OF = {"total": ("rmse", "p95"), "heading": ("rmse",), "tilt": ("rmse", "p95")}
ERRORS = {
    angle: MetricGroup(
        f"{NAMES[angle]} error",
        "Accuracy",
        tuple(_metric(angle, statistic) for statistic in statistics),
        partial(compute_errors, angle),
        needs=(why_no_errors,) if angle == "tilt" else (why_no_errors, why_no_heading),
    )
    for angle, statistics in STATISTICS_OF.items()
}
COVERAGE = MetricGroup("coverage", "Accuracy", (COVERAGE_METRIC,), compute_coverage)
METRIC_GROUPS = (*ERRORS.values(), COVERAGE)
