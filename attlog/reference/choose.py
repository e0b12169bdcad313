"""Which attitude the others are compared with: truth, the smoother, the onboard one, or none."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from attlog.base.errors import AttlogError, UsageError
from attlog.estimators.base import Estimate
from attlog.flight.model import Attitude, FlightLog, part_of
from attlog.reference import clock, smoothed
from attlog.reference.build import build, frozen, without
from attlog.reference.model import AlignmentStep, Reference, ReferenceOptions, SensorFault
from attlog.reference.physics import accusing, onboard_heading, sensor_faults, standing, turning
from attlog.segments import Segments, resets

Smooth = Callable[[], Estimate]
"""Runs the smoother over the log; AttlogError says why it cannot."""
NOTHING = "the log holds neither truth nor an onboard attitude"


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
        kind = smoothed.NAME
    out = dict(refused or {})
    what = "Whether attitudes turn as the gyro does"
    faults = part_of(log, what, lambda: _turn_otherwise(log, segments), dict[str, turning.TurningFault])
    gyro_fault = next((fault.why for fault in faults.values() if fault.of == "gyro"), "")
    broken = sensor_faults.found(log, segments)
    if kind != "auto":
        asked = _asked(log, segments, options, kind, smooth)
        doubt = asked.doubt or _doubt(log, segments, asked, faults)
        if log.true_heading is not None and asked.kind == smoothed.NAME:
            asked = smoothed.with_true_heading(asked, log.true_heading)
        return replace(asked, gyro_fault=gyro_fault, sensor_faults=broken, doubt=doubt)
    out |= {name: fault.why for name, fault in faults.items() if fault.of == "attitude"}
    misled = gyro_fault or next((fault.why for fault in broken.values() if fault.misleads), "")
    out |= {smoothed.NAME: misled} if misled else {}
    wrong = part_of(log, "The heading by GNSS", lambda: onboard_heading.wrong_onboard(log, segments), str)
    best = _best(log, segments, options, smooth, out, second, broken, wrong, heading)
    return replace(best, gyro_fault=gyro_fault, sensor_faults=broken, wrong_heading=wrong)


def _doubt(log: FlightLog, segments: Segments, asked: Reference, faults: Mapping[str, turning.TurningFault]) -> str:
    """Why a reference that was asked for would be refused; empty where it would not."""
    if asked.kind == "smoother":
        found = standing.residuals(log, asked, log.onboard_attitude)
        return "" if found is None else standing.refusal(found, asked, log.onboard or "onboard")[0]
    if asked.fault:
        return asked.fault
    turned = faults.get(asked.kind)
    if turned is not None and turned.of == "attitude":
        return turned.why
    flew = asked.kind == "onboard" and asked.name == log.onboard
    return onboard_heading.wrong_onboard(log, segments) if flew else ""


def _turn_otherwise(log: FlightLog, segments: Segments) -> dict[str, turning.TurningFault]:
    """Which of truth and the onboard attitude does not turn as the replayed gyro does, and who is wrong."""
    imu, mag = log.replay_imu, None if log.mag is None else log.mags[log.mag]
    found: dict[str, turning.TurningFault] = {}
    for name, attitude in (("truth", log.truth), ("onboard", log.onboard_attitude)):
        if imu is not None and attitude is not None:
            of_log = attitude is log.onboard_attitude
            jumps, _ = resets.known(log, log.onboard or "", segments) if of_log else resets.find(attitude, imu)
            found[name] = turning.contradiction(imu, attitude, jumps, mag)
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
        smoother.onboard_error = wrong_heading or accusing.onboard_error(log, segments, smoother)
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
        return _taken(onboard, out | ({smoothed.NAME: unsure} if unsure else {}))
    return _nothing(log, segments, options, out)


def _tilted(log: FlightLog, smoother: Reference) -> str:
    """Why a smoother that is not sure of its tilt refuses the onboard attitude: gravity says so of both."""
    found = standing.residuals(log, smoother, log.onboard_attitude)
    return "" if found is None else standing.wrong(found, log.onboard or "", "the smoother")


def _sound(
    name: str, attitude: Reference | None, log: FlightLog, out: dict[str, str], broken: Mapping[str, SensorFault]
) -> bool:
    """Whether there is this attitude and nothing speaks against it; why something does goes into ``out``.

    An accelerometer whose down the field contradicts accuses no attitude: then only one that stands still is refused.
    """
    if attitude is None:
        return False
    if sensor_faults.FRAME in broken:
        attitude.fault = frozen(attitude, log.replay_imu)
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
    found = second or (None if smooth is None or smoothed.NAME in out else _smoothed(log, segments, options, smooth))
    if isinstance(found, str) or (found is not None and found.fault):
        out[smoothed.NAME] = found if isinstance(found, str) else found.fault
        return None
    if found is not None and found is not second and (why := _off_gravity(log, found)):
        out[smoothed.NAME] = why
        return None
    return found


def _off_gravity(log: FlightLog, smoother: Reference) -> str:
    """Why gravity refuses a smoother throughout, empty where it does not; where it does now and then, a step."""
    found = standing.residuals(log, smoother, log.onboard_attitude)
    if found is None:
        return ""
    why, smoother.refuted = standing.refusal(found, smoother, log.onboard or "onboard")
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
    fault = next((why for kind, why in refused.items() if kind != smoothed.NAME), "")
    doubt = f"; smoother refused: {refused[smoothed.NAME]}" if smoothed.NAME in refused else ""
    nothing = without(log, log.replay_imu, segments, options, (fault or NOTHING) + doubt)
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
        return without(log, log.replay_imu, segments, options, "no reference, as asked")
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
    return build(log, segments, options, "truth", "", log.truth, why)


def _onboard(log: FlightLog, segments: Segments, options: ReferenceOptions, named: str = "") -> Reference | None:
    """The onboard attitude, or the one that is named, as reference; None where the log has none."""
    attitude = log.attitudes.get(named or log.onboard or "")
    if attitude is None or not (named or _enough(attitude)):
        return None
    why = "as asked" if named else log.choices.get("onboard", "the onboard attitude")
    return build(log, segments, options, "onboard", named or log.onboard or "", attitude, why)


def _smoothed(log: FlightLog, segments: Segments, options: ReferenceOptions, smooth: Smooth) -> Reference | str:
    """What the smoother found with its own sigma, or why it is of no use.

    One that was asked for is taken whatever its own checks say, which then stands in the text.
    """
    try:
        estimate = smooth()
    except AttlogError as error:
        return str(error)
    failed = smoothed.why_not(estimate)
    if failed and (options.reference == "auto" or not smoothed.tells_sigma(estimate)):
        return failed
    t, q, segment, tilt, heading = smoothed.thinned(estimate)
    why = f"own estimate from both sides of each moment, aided by {smoothed.aided_by(estimate)}"
    reference = build(log, segments, options, "smoother", "", Attitude(t, q, "the smoother"), why, segment)
    used = np.isin(t, reference.t)
    reference.sigma_tilt_deg, reference.sigma_heading_deg = tilt[used], heading[used]
    reference.gyro_jumps = smoothed.gyro_jumps(estimate)
    reference.quality, reference.doubt = dict(estimate.quality), failed
    own = [smoothed.sigma_deg(reference, angle) for angle in ("inclination", "heading")]
    if not own[0] <= smoothed.USELESS_DEG and options.reference == "auto":
        return f"own tilt sigma {own[0]:.1f} deg" if np.isfinite(own[0]) else "none of its attitudes is scored"
    of_heading = f"heading {own[1]:.2f} deg" if own[1] < smoothed.UNKNOWN_DEG else "no heading"
    text = f"its own sigma: tilt {own[0]:.2f} deg, {of_heading} (RMS)"
    text += f"; its own checks fail: {failed}" if failed else ""
    reference.steps.insert(1, AlignmentStep("own_sigma", text, own[0], "deg", "the smoother"))
    return reference


def _known(log: FlightLog) -> str:
    return ", ".join(f"onboard:{name}" for name in log.attitudes) or "no attitude at all"


def _enough(attitude: Attitude) -> bool:
    return len(clock.usable(attitude, "publication")[0]) >= 2
