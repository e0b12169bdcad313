"""A reference made of an attitude, with every step between the two."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.errors import AttlogError, UsageError
from attlog.estimators.interface import Estimate
from attlog.flight.model import Attitude, FlightLog, Imu, guarded_part
from attlog.reference import (
    alignment,
    gyro_checks,
    heading_sources,
    onboard_check,
    reference_checks,
    scoring,
    sensor_faults,
)
from attlog.reference import smoother as smoothed
from attlog.reference.model import AlignmentStep, Reference, ReferenceOptions, SensorFault
from attlog.segments import Segments, model, resets

Array = NDArray[np.float64]
Kind = Literal["truth", "smoother", "onboard"]

SLOW_HZ = 5.0

# A gyro that varies by more than this does not belong to an attitude that never changes.
FROZEN_DPS = 5.0


def build_reference(
    log: FlightLog,
    segments: Segments,
    options: ReferenceOptions,
    kind: Kind,
    name: str,
    attitude: Attitude,
    why: str,
    restarts: NDArray[np.int64] | None = None,
) -> Reference:
    """The reference that an attitude makes; ``restarts`` (n,) are its segments if it has its own and no resets."""
    imu, which = log.replay_imu, _clock(options)
    t, q, kept = alignment.usable_samples(attitude, which)
    gap_segment = _gap_segments(t, segments)
    if restarts is not None:
        found, sentences = np.zeros(0, np.int64), list[str]()
        gap_segment = model.merge_numbers(gap_segment, restarts[kept])
    elif kind == "onboard":
        found, sentences = resets.known_resets(log, name, segments)
    else:
        found, sentences = resets.find_resets(attitude, imu)
    jumped = np.zeros(len(attitude.t), np.int64)
    jumped[found] = 1
    segment = gap_segment + np.cumsum(jumped)[kept]
    reference = Reference(
        kind, attitude.source, t, q, gap_segment, model.merge_numbers(segment), name=name, clock=which
    )
    reference.rate = model.sample_rate(t)
    if attitude.fit is not None:
        alignment.adopt_fit(reference, attitude.fit)
    reference.trim, trim_step = alignment.trim_step(log, _in_axes_of(log, kind, attitude), options.trim)
    if kind == "smoother" and reference.trim is not None:
        reference.q = q = alignment.apply_trim(q, reference.trim)
    reference.floor_deg, reference.step_deg, floor_step = alignment.floor_step(t, q, attitude.step_deg, imu)
    start_step = _set_scoring(reference, _imu_times(imu, t), segments, options)
    aligned = scoring.aligned_at(attitude, found, segments) if kind == "onboard" else None
    if aligned is not None:
        reference.unscored = [(-np.inf, aligned), *reference.unscored]
        text = "its own alignment: nothing is compared with it before this jump"
        start_step.append(AlignmentStep("alignment", text, aligned, "s", attitude.source))
    reference.declination_deg, north = alignment.declination_step(log, options.declination)
    reference.input_delay_s, lag = alignment.delay_step(log, imu, reference, options.input_delay)
    reference.fault, gravity_step = reference_checks.gravity_check(reference, imu, segments)
    reference.fault = reference.fault or stuck_attitude(reference, imu)
    reference.steps = [
        AlignmentStep("reference", why, kind, source=attitude.source, option="--reference"),
        alignment.clock_step(log, attitude, which, kind == "smoother"),
        *(() if attitude.fit is None else alignment.fit_steps(attitude.fit)),
        lag,
        _resampling_step(reference),
        AlignmentStep("resets", _reset_text(sentences), float(len(found)), "", attitude.source, len(found) > 0),
        *_north_steps(log, reference, north),
        trim_step,
        *gravity_step,
        *start_step,
        floor_step,
    ]
    return reference


def _in_axes_of(log: FlightLog, kind: Kind, attitude: Attitude) -> Attitude:
    """The attitude whose axes the comparison is made in: a smoother, made from the IMU, comes to the onboard ones."""
    return log.onboard_attitude or attitude if kind == "smoother" else attitude


def _clock(options: ReferenceOptions) -> alignment.Clock:
    return "publication" if options.clock == "publication" else "sample"


def no_reference(log: FlightLog, imu: Imu | None, segments: Segments, options: ReferenceOptions, why: str) -> Reference:
    """No reference: only questions at rest can be answered."""
    zero = np.zeros(0)
    index = np.zeros(0, np.int64)
    reference = Reference("none", "", zero, np.zeros((0, 4)), index, index, clock=_clock(options))
    reference.declination_deg, north = alignment.declination_step(log, options.declination)
    start = _set_scoring(reference, _imu_times(imu, zero), segments, options)
    reference.steps = [AlignmentStep("reference", why, "none", option="--reference"), north, *start]
    return reference


def _imu_times(imu: Imu | None, otherwise: Array) -> Array:
    t = otherwise if imu is None else imu.gyro.t_best
    return t[np.isfinite(t)]


def _gap_segments(t: Array, segments: Segments) -> NDArray[np.int64]:
    """The segment number of each time (n,): a gap of the attitude or of the replayed IMU begins a new one."""
    starts = np.array([s.t0 for s in segments.of("continuous")][1:])
    return model.merge_numbers(model.number_segments(t), np.searchsorted(starts, t, side="right"))


def _set_scoring(reference: Reference, t: Array, segments: Segments, options: ReferenceOptions) -> list[AlignmentStep]:
    """Set start, end and unscored segments of a reference; returns the steps that tell them."""
    reference.scoring_start, reference.unscored = scoring.start_and_unscored(t, options.score_from)
    why = (
        "given by the user"
        if options.score_from is not None
        else ("15 s after the first IMU sample, a third of a log shorter than 30 s")
    )
    if reference.unscored:
        why += f"; {len(reference.unscored)} restarts after gaps, each followed by unscored seconds"
    steps = [AlignmentStep("scoring_start", why, reference.scoring_start, "s", "the IMU", option="config: score_from")]
    reference.unscored += [(lost.t0, lost.t1) for lost in segments.of("loss_of_control")]
    impacts = segments.of("impact")
    if impacts:
        reference.end = impacts[0].t0
        steps.append(AlignmentStep("scoring_end", impacts[0].why, reference.end, "s", "impact"))
    return steps


def _resampling_step(reference: Reference) -> AlignmentStep:
    text = f"{reference.rate:.1f} Hz; faster rows are compared at its times, slower ones at their own"
    if reference.rate < SLOW_HZ:
        text += "; too slow for lag, only rest and drift are answered"
    return AlignmentStep("resampling", text, reference.rate, "Hz", reference.source)


def _reset_text(sentences: list[str]) -> str:
    if not sentences:
        return "no reset of this attitude found"
    different = list(dict.fromkeys(sentences))
    count = f"{len(sentences)} reset{'s' if len(sentences) > 1 else ''}"
    return f"{count}, cut out: {'; '.join(different[:3])}{' ...' if len(different) > 3 else ''}"


def _north_steps(log: FlightLog, reference: Reference, north: AlignmentStep) -> list[AlignmentStep]:
    """The declination, and where a reference that knows north sees the magnetic one."""
    seen = None if reference.heading_by == "relative" else alignment.observed_declination_deg(log, reference)
    if seen is None:
        return [north]
    text = f"the measured field, turned by {reference.source}, points this far east of its north (median)"
    return [north, AlignmentStep("declination_seen", text, seen, "deg", "the log", False)]


def stuck_attitude(reference: Reference, imu: Imu | None) -> str:
    """A sentence if the reference never moves while the gyro turns faster than an offset explains, else nothing."""
    if imu is None or not len(imu.gyro.x):
        return ""
    t = imu.gyro.t_best
    known = rotation.finite_rows(imu.gyro.x) & (t >= reference.t[0]) & (t <= reference.t[-1])
    good = imu.gyro.x[known]
    spread = np.std(good, axis=0) if len(good) else np.zeros(3)
    turning = float(np.degrees(np.sqrt(np.sum(spread**2))))
    if turning < FROZEN_DPS or np.ptp(reference.q, axis=0).max() > 1e-9:
        return ""
    return f"{reference.source} never changes while the gyro turns by {turning:.0f} deg/s rms: it holds no attitude"


# Which attitude the others are compared with: truth, the smoother, the onboard one, or none.

# Runs the smoother over the log; AttlogError says why it cannot.
Smooth = Callable[[], Estimate]
NO_ATTITUDE = "the log holds neither truth nor an onboard attitude"


def choose(
    log: FlightLog,
    segments: Segments,
    options: ReferenceOptions | None = None,
    *,
    smooth: Smooth | None = None,
    refused: Mapping[str, str] | None = None,
    second: Reference | None = None,
    heading: bool = True,
) -> Reference:
    """The reference of a log: truth, else the smoother, else the onboard attitude, else none; with its steps.

    ``smooth`` runs the smoother and is called only where it is wanted (None: there is none);
    ``refused``: attitudes that are out for a reason found before, ``second`` the smoother that stood behind them.
    ``heading``: whether headings are compared; else an onboard attitude whose heading is wrong is taken all the same.
    UsageError for an option that names something the log does not hold.

    Refused for the next best unless the user asked for it is an attitude that gravity contradicts
    by more than 10 deg or that stands still while the gyro turns; a smoother that gravity refuses where the
    vehicle stands still, or that is not sure of its tilt, if the onboard attitude is sound; an onboard attitude whose
    heading GNSS acceleration contradicts, or of which gravity says that such a smoother is right and it is wrong. No
    smoother is made of a gyro that is not the one that turned (``reference.turning``). Nothing is borrowed from an
    onboard attitude that is in error by the smoother.
    """
    options = options or ReferenceOptions()
    if options.clock not in ("sample", "publication"):
        raise UsageError(f"clock {options.clock!r}: use sample or publication")
    kind = _wanted(options.reference)
    if kind == "auto" and log.truth is not None and log.truth.fit is not None:
        kind = "truth"  # who brings one wants it, whatever speaks against it, which is told
    if kind == "auto" and log.true_heading is not None and smooth is not None:
        kind = smoothed.SMOOTHER
    out = dict(refused or {})
    what = "Whether attitudes turn as the gyro does"
    faults = guarded_part(log, what, lambda: _gyro_mismatches(log, segments), dict[str, gyro_checks.GyroMismatch])
    gyro_fault = next((fault.why for fault in faults.values() if fault.of == "gyro"), "")
    broken = sensor_faults.find_sensor_faults(log, segments)
    if kind != "auto":
        asked = _asked(log, segments, options, kind, smooth)
        doubt = asked.doubt or _doubt(log, segments, asked, faults)
        if log.true_heading is not None and asked.kind == smoothed.SMOOTHER:
            asked = smoothed.with_true_heading(asked, log.true_heading)
        return replace(asked, gyro_fault=gyro_fault, sensor_faults=broken, doubt=doubt)
    out |= {name: fault.why for name, fault in faults.items() if fault.of == "attitude"}
    misled = gyro_fault or next((fault.why for fault in broken.values() if fault.misleads), "")
    out |= {smoothed.SMOOTHER: misled} if misled else {}
    wrong = guarded_part(log, "The heading by GNSS", lambda: heading_sources.wrong_onboard_heading(log, segments), str)
    best = _best(log, segments, options, smooth, out, second, broken, wrong, heading)
    return replace(best, gyro_fault=gyro_fault, sensor_faults=broken, wrong_heading=wrong)


def _doubt(log: FlightLog, segments: Segments, asked: Reference, faults: Mapping[str, gyro_checks.GyroMismatch]) -> str:
    """Why a reference that was asked for would be refused; empty where it would not."""
    if asked.kind == "smoother":
        found = reference_checks.static_tilt(log, asked, log.onboard_attitude)
        return "" if found is None else reference_checks.static_tilt_refusal(found, asked, log.onboard or "onboard")[0]
    if asked.fault:
        return asked.fault
    turned = faults.get(asked.kind)
    if turned is not None and turned.of == "attitude":
        return turned.why
    flew = asked.kind == "onboard" and asked.name == log.onboard
    return heading_sources.wrong_onboard_heading(log, segments) if flew else ""


def _gyro_mismatches(log: FlightLog, segments: Segments) -> dict[str, gyro_checks.GyroMismatch]:
    """Which of truth and the onboard attitude does not turn as the replayed gyro does, and who is wrong."""
    imu, mag = log.replay_imu, None if log.mag is None else log.mags[log.mag]
    found: dict[str, gyro_checks.GyroMismatch] = {}
    for name, attitude in (("truth", log.truth), ("onboard", log.onboard_attitude)):
        if imu is not None and attitude is not None:
            of_log = attitude is log.onboard_attitude
            jumps, _ = (
                resets.known_resets(log, log.onboard or "", segments) if of_log else resets.find_resets(attitude, imu)
            )
            found[name] = gyro_checks.gyro_consistency(imu, attitude, jumps, mag)
    return found


def _best(
    log: FlightLog,
    segments: Segments,
    options: ReferenceOptions,
    smooth: Smooth | None,
    out: dict[str, str],
    second: Reference | None,
    broken: Mapping[str, SensorFault],
    wrong_heading: str,
    heading: bool,
) -> Reference:
    """The first of truth, smoother and onboard attitude that nothing speaks against; ``out``: those already refused.

    ``broken``: what is wrong with the sensors, ``wrong_heading``: why the onboard heading is, which counts where a
    ``heading`` is wanted.
    """
    truth = None if "truth" in out else _truth(log, segments, options)
    if _sound("truth", truth, log, out, broken):
        assert truth is not None
        return truth
    smoother = _own_smoother(log, segments, options, smooth, out, second)
    unsure = "" if smoother is None else smoothed.unsure_of_tilt(smoother)
    if smoother is not None and smoother is not second:
        smoother.unscored = [*smoother.unscored, *smoother.refuted]
    if smoother is not None and not unsure:
        smoother.onboard_error = wrong_heading or onboard_check.onboard_error(log, segments, smoother)
        if smoothed.sure_of_heading(smoother):
            return _taken(smoother, out)
    onboard = None if "onboard" in out else _onboard(log, segments, options)
    if onboard is not None and wrong_heading and heading:
        out["onboard"], onboard = wrong_heading, None
    if not _sound("onboard", onboard, log, out, broken):
        onboard = None
    if onboard is not None and smoother is not None and unsure and (why := _tilted(log, smoother)):
        out["onboard"], onboard = why, None
    # a smoother that is sure of its tilt alone borrows a sound heading; one that is not stands back
    if smoother is not None and (onboard is None or not unsure):
        lender = None if smoother.onboard_error else onboard
        return _taken(smoothed.with_heading_of(smoother, lender), out)
    if onboard is not None:
        onboard.second = smoother
        if wrong_heading:
            onboard.heading_by, onboard.heading_why = "nobody", wrong_heading
        return _taken(onboard, out | ({smoothed.SMOOTHER: unsure} if unsure else {}))
    return _nothing(log, segments, options, out)


def _tilted(log: FlightLog, smoother: Reference) -> str:
    """Why a smoother that is not sure of its tilt refuses the onboard attitude: gravity says so of both."""
    found = reference_checks.static_tilt(log, smoother, log.onboard_attitude)
    return "" if found is None else reference_checks.onboard_tilted(found, log.onboard or "", "the smoother")


def _sound(
    name: str, attitude: Reference | None, log: FlightLog, out: dict[str, str], broken: Mapping[str, SensorFault]
) -> bool:
    """Whether there is this attitude and nothing speaks against it; why something does goes into ``out``.

    An accelerometer whose down the field contradicts accuses no attitude: then only one that stands still is refused.
    """
    if attitude is None:
        return False
    if sensor_faults.FRAME in broken:
        attitude.fault = stuck_attitude(attitude, log.replay_imu)
    if attitude.fault:
        out[name] = attitude.fault
    return not attitude.fault


def _own_smoother(
    log: FlightLog,
    segments: Segments,
    options: ReferenceOptions,
    smooth: Smooth | None,
    out: dict[str, str],
    second: Reference | None,
) -> Reference | None:
    """The smoother, run where it was not yet (``second``); None where it is refused, with the reason in ``out``."""
    found = second or (
        None if smooth is None or smoothed.SMOOTHER in out else _smoothed(log, segments, options, smooth)
    )
    if isinstance(found, str) or (found is not None and found.fault):
        out[smoothed.SMOOTHER] = found if isinstance(found, str) else found.fault
        return None
    if found is not None and found is not second and (why := _off_gravity(log, found)):
        out[smoothed.SMOOTHER] = why
        return None
    return found


def _off_gravity(log: FlightLog, smoother: Reference) -> str:
    """Why gravity refuses a smoother throughout, empty where it does not; where it does now and then, a step."""
    found = reference_checks.static_tilt(log, smoother, log.onboard_attitude)
    if found is None:
        return ""
    why, smoother.refuted = reference_checks.static_tilt_refusal(found, smoother, log.onboard or "onboard")
    if smoother.refuted and not why:
        text = "standing still it is off gravity for so long in all: nothing is scored there"
        seconds = sum(b - a for a, b in smoother.refuted)
        smoother.steps.append(AlignmentStep("gravity_at_standstill", text, seconds, "s", "the accelerometer"))
    return why


def _taken(reference: Reference, refused: dict[str, str]) -> Reference:
    """A reference whose first step names the better attitudes that were not taken, and why."""
    why_not = "".join(f"; {name} refused: {why}" for name, why in refused.items())
    reference.steps[0] = replace(reference.steps[0], text=reference.steps[0].text + why_not)
    reference.refused = refused
    return reference


def _nothing(log: FlightLog, segments: Segments, options: ReferenceOptions, refused: dict[str, str]) -> Reference:
    """No reference; with a fault where an attitude was refused by physics and not by its own doubt."""
    fault = next((why for kind, why in refused.items() if kind != smoothed.SMOOTHER), "")
    doubt = f"; smoother refused: {refused[smoothed.SMOOTHER]}" if smoothed.SMOOTHER in refused else ""
    nothing = no_reference(log, log.replay_imu, segments, options, (fault or NO_ATTITUDE) + doubt)
    nothing.fault, nothing.refused = fault, refused
    return nothing


def _wanted(option: str) -> str:
    """The kind of reference that is asked for. UsageError for an option that is none."""
    kind, _, named = option.partition(":")
    if kind not in ("auto", "truth", "smoother", "onboard", "none") or (named and kind != "onboard"):
        raise UsageError(f"reference {option!r}: use auto, truth, smoother, onboard, onboard:NAME or none")
    return kind


def _asked(
    log: FlightLog, segments: Segments, options: ReferenceOptions, kind: str, smooth: Smooth | None
) -> Reference:
    """What the user asked for, whatever is wrong with it. UsageError where it is not there."""
    if kind == "none":
        return no_reference(log, log.replay_imu, segments, options, "no reference, as asked")
    found: Reference | str | None
    if kind == "smoother":
        found = "it was not run" if smooth is None else _smoothed(log, segments, options, smooth)
        missing = f"{log.path.name}: {found}"
    elif kind == "truth":
        found, missing = _truth(log, segments, options), f"{log.path.name} holds no truth; it has {_known(log)}"
    else:
        named = options.reference.partition(":")[2]
        if named and named not in log.attitudes:
            raise UsageError(f"reference {options.reference!r}: {log.path.name} holds {_known(log)}")
        found = _onboard(log, segments, options, named)
        missing = f"{log.path.name} holds no onboard attitude"
    if found is None or isinstance(found, str):
        raise UsageError(f"reference {kind}: {missing}")
    return found


def _truth(log: FlightLog, segments: Segments, options: ReferenceOptions) -> Reference | None:
    """The truth of the log as reference, None where it has none."""
    if log.truth is None or not _enough(log.truth):
        return None
    why = "the log holds the truth" if log.truth.fit is None else "you brought it"
    return build_reference(log, segments, options, "truth", "", log.truth, why)


def _onboard(log: FlightLog, segments: Segments, options: ReferenceOptions, named: str = "") -> Reference | None:
    """The onboard attitude, or the one that is named, as reference; None where the log has none."""
    attitude = log.attitudes.get(named or log.onboard or "")
    if attitude is None or not (named or _enough(attitude)):
        return None
    why = "as asked" if named else log.choices.get("onboard", "the onboard attitude")
    return build_reference(log, segments, options, "onboard", named or log.onboard or "", attitude, why)


def _smoothed(log: FlightLog, segments: Segments, options: ReferenceOptions, smooth: Smooth) -> Reference | str:
    """What the smoother found with its own sigma, or why it is of no use.

    One that was asked for is taken whatever its own checks say, which then stands in the text.
    """
    try:
        estimate = smooth()
    except AttlogError as error:
        return str(error)
    failed = smoothed.reason_unusable(estimate)
    if failed and (options.reference == "auto" or not smoothed.has_sigma(estimate)):
        return failed
    t, q, segment, tilt, heading = smoothed.thin(estimate)
    why = f"own estimate from both sides of each moment, aided by {smoothed.aided_by(estimate)}"
    reference = build_reference(log, segments, options, "smoother", "", Attitude(t, q, "the smoother"), why, segment)
    used = np.isin(t, reference.t)
    reference.sigma_tilt_deg, reference.sigma_heading_deg = tilt[used], heading[used]
    reference.gyro_jumps = smoothed.gyro_jumps(estimate)
    reference.quality, reference.doubt = dict(estimate.quality), failed
    own = [smoothed.sigma_deg(reference, angle) for angle in ("tilt", "heading")]
    if not own[0] <= smoothed.MAX_USABLE_SIGMA_DEG and options.reference == "auto":
        return f"own tilt sigma {own[0]:.1f} deg" if np.isfinite(own[0]) else "none of its attitudes is scored"
    of_heading = f"heading {own[1]:.2f} deg" if own[1] < smoothed.UNKNOWN_HEADING_DEG else "no heading"
    text = f"its own sigma: tilt {own[0]:.2f} deg, {of_heading} (RMS)"
    text += f"; its own checks fail: {failed}" if failed else ""
    reference.steps.insert(1, AlignmentStep("own_sigma", text, own[0], "deg", "the smoother"))
    return reference


def _known(log: FlightLog) -> str:
    return ", ".join(f"onboard:{name}" for name in log.attitudes) or "no attitude at all"


def _enough(attitude: Attitude) -> bool:
    return len(alignment.usable_samples(attitude, "publication")[0]) >= 2
