"""Smoother as reference: acceptance, heading, and the meaning of agreement.

A smoother uses the samples before and after each time and reports its sigma. It is a reference if its own checks pass
and its sigma is small.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.errors import UsageError
from attlog.core.sorting import median
from attlog.core.spans import Span, complement, intersect
from attlog.estimators.interface import Estimate
from attlog.flight.model import FlightLog, Stream
from attlog.reference import scoring
from attlog.reference.model import SMOOTHER, Alignment, AlignmentStep, GyroJump, HeadingOrigin, Reference
from attlog.segments import Segments, model
from attlog.segments.model import interpolate_attitudes

Array = NDArray[np.float64]

# Limits of the tilt sigma: above the first, a sound onboard attitude takes precedence; above the second, the smoother
# is never chosen. The first is also the limit of the heading sigma for comparisons of heading.
MAX_SIGMA_DEG, MAX_USABLE_SIGMA_DEG = 1.0, 3.0
# Limits of its own checks: resumptions of a rejected sensor, share of GNSS velocities that do not fit, and largest
# ratio of a sensor's errors to the expected ones.
MAX_REOPENINGS, MAX_SOFT_GATED_PCT, MAX_ERROR_RATIO = 5.0, 40.0, 3.0
# Larger heading sigmas mean an unknown heading (reported as pi).
UNKNOWN_HEADING_DEG = 90.0
# Shortest segment that a smoother can use, and longest log: it takes minutes and gigabytes.
SMOOTHED_SECONDS = 20.0, 1800.0
# Range of the median specific force. An accelerometer in g or a dead one would give a wrong tilt with a small sigma.
FORCE_RANGE_M_S2 = 6.0, 14.0
# Faster attitudes are thinned to this rate or more: slerp over 5 ms is exact enough for any vehicle.
MAX_REFERENCE_HZ = 200.0
# Time before an impact that filters ahead of the logger and time stamps may smear it into.
BEFORE_IMPACT_S = 0.3
# Control is lost this long before the tilt exceeds 90 deg.
TIPPING_S = 1.0
# Smallest share of the smoothed time with sound segments.
MIN_COVERED_SHARE = 0.5
FIX_3D = 3
# Averaging time of the difference to a borrowed heading, long enough to keep steps.
HEADING_MEAN_S = 2.0


def smoothable(log: FlightLog, segments: Segments) -> list[Span]:
    """Return the spans in which a smoother can be run.

    Between gaps, up to an impact, without loss of control (a tumble would corrupt the time around it), none shorter
    than SMOOTHED_SECONDS.
    """
    imu = log.replay_imu
    t = np.zeros(0) if imu is None else imu.gyro.t_best[np.isfinite(imu.gyro.t_best)]
    if len(t) == 0:
        return []
    end = min((s.t0 for s in segments.of("impact")), default=np.inf) - BEFORE_IMPACT_S
    starts = model.restart_times(t)
    lasts = np.append(t[np.searchsorted(t, starts[1:]) - 1], t[-1])
    lost = [(s.t0 - TIPPING_S, s.t1) for s in segments.of("loss_of_control")]
    whole = [(float(a), min(float(b), end)) for a, b in zip(starts, lasts, strict=True)]
    clear = complement(lost, float(t[0]), float(t[-1]))
    return [(a, b) for a, b in intersect(whole, clear) if b - a >= SMOOTHED_SECONDS[0]]


def reason_not_smoothed(log: FlightLog, segments: Segments) -> str:
    """Return why the smoother is not run by default, or empty."""
    if log.replay_imu is None:
        return "no IMU is replayed"
    force = rotation.length(log.replay_imu.acc.x)
    shown = float(median(force[np.isfinite(force)])) if np.isfinite(force).any() else 0.0
    if not FORCE_RANGE_M_S2[0] <= shown <= FORCE_RANGE_M_S2[1]:
        return f"the accelerometer shows {shown:.2g} m/s^2 (median), which is no gravity"
    seconds = sum(b - a for a, b in smoothable(log, segments))
    if seconds > SMOOTHED_SECONDS[1]:
        return f"{seconds / 60:.0f} min would cost minutes; up to {SMOOTHED_SECONDS[1] / 60:.0f} min are smoothed"
    if seconds > 0:
        return ""
    return f"it needs {SMOOTHED_SECONDS[0]:.0f} s without a gap, an impact or a loss of control"


def expected_reference(log: FlightLog, segments: Segments, chosen: Reference) -> str:
    """Return the expected reference of an analysis in words."""
    otherwise = {"truth": "the logged truth", "onboard": f"the onboard attitude ({chosen.source})"}.get(
        chosen.kind, "nothing: no attitude in this log can be trusted" if chosen.faults.reference else "nothing"
    )
    if chosen.kind == "truth":
        return f"{otherwise}." if chosen.fit is None else f"the external truth ({chosen.source})."
    if why := chosen.faults.gyro or reason_not_smoothed(log, segments):
        return f"{otherwise} (no smoother: {why})."
    located = any(np.count_nonzero(g.fix >= FIX_3D) > 1 for g in log.gnss)
    aids = [word for word, there in (("GNSS", located), ("magnetometer", log.mag is not None)) if there]
    unsure = "" if located else " Without GNSS its heading is hardly sure enough to be compared with."
    by = " and ".join(aids) or "gravity alone"
    return f"the smoother, aided by {by}, if its own checks pass; else {otherwise}.{unsure}"


def reason_unusable(estimate: Estimate) -> str:
    """Return why a smoother failed its own checks; empty if it passed."""
    if len(estimate.t) < 2:
        return "no sample of the log can be used"
    if not has_sigma(estimate):
        return "it does not say how wrong it may be"
    if not np.isfinite(estimate.q).all():
        return "it lost its way: some of its attitudes are no numbers"
    openings, soft, ratio = (_number(estimate, n) for n in ("openings", "soft_gated_pct", "worst_ratio"))
    if openings > MAX_REOPENINGS:
        return f"a sensor contradicted it for so long that it gave way {openings:.0f} times"
    if soft > MAX_SOFT_GATED_PCT:
        return f"{soft:.0f} % of the GNSS velocities do not fit its attitude"
    if ratio > MAX_ERROR_RATIO:
        return f"a sensor's errors are {ratio:.1f} times what it expects of them"
    return ""


def aid_contradicted(found: Sequence[Estimate]) -> bool:
    """Return whether a single aid may be what makes a smoother fail its own checks."""
    return any(
        _number(one, "openings") > MAX_REOPENINGS or _number(one, "worst_ratio") > MAX_ERROR_RATIO for one in found
    )


def join_segments(found: Sequence[Estimate], *, whatever: bool = False) -> Estimate:
    """Join the estimates of consecutive segments that pass their own checks.

    ``whatever``: join all. A segment without a heading is left out if the others cover half of the time: otherwise no
    heading could be compared. ``quality`` is that of the longest segment; its heading is from the compass alone if that
    of any segment is. UsageError if less than half of the time remains.
    """
    why = {k: reason_unusable(one) for k, one in enumerate(found)}
    length = [float(one.t[-1] - one.t[0]) if len(one.t) else 0.0 for one in found]
    headless = [k for k in why if not why[k] and found[k].quality.get("heading_from") == "none"]
    if sum(length[k] for k in why if not why[k] and k not in headless) >= MIN_COVERED_SHARE * sum(length):
        why |= {k: str(found[k].quality["heading_why"]) for k in headless}
    sound = [one for k, one in enumerate(found) if whatever or not why[k]]
    kept = sum(length[k] for k in why if whatever or not why[k])
    longest = int(np.argmax([length[k] if why[k] else 0.0 for k in why])) if found else 0
    if not sound or kept < MIN_COVERED_SHARE * sum(length):
        raise UsageError(why.get(longest, "no segment of the log can be smoothed"))
    longest_sound = max(sound, key=lambda one: len(one.t))
    quality = dict(longest_sound.quality)
    if quality.get("heading_from") != "none" and any(one.quality.get("heading_from") == "compass" for one in sound):
        quality["heading_from"] = "compass"
    counts = [np.full(len(one.t), k) for k, one in enumerate(sound)]
    names = set.intersection(*(set(one.aux) for one in sound))
    return replace(
        longest_sound,
        t=np.concatenate([one.t for one in sound]),
        q=np.concatenate([one.q for one in sound]),
        bias=None,
        quality=quality,
        aux={name: np.concatenate([one.aux[name] for one in sound]) for name in sorted(names)},
        segment=np.concatenate(counts),
    )


def has_sigma(estimate: Estimate) -> bool:
    """Return whether an estimate reports its sigma of tilt and heading."""
    return len(estimate.t) > 1 and {"sigma_tilt", "sigma_heading"} <= estimate.aux.keys()


def gyro_jumps(estimate: Estimate) -> tuple[GyroJump, ...] | None:
    """Return the largest gyro bias step found by a smoother.

    Empty if it found none, None if it does not search.
    """
    if "gyro_jumps" not in estimate.quality:
        return None
    if "gyro_jump_s" not in estimate.quality:
        return ()
    x, y, z, sigma_x, sigma_y, sigma_z = (
        _number(estimate, f"gyro_jump_{axis}_{kind}") for kind in ("dps", "sigma_dps") for axis in "xyz"
    )
    return (GyroJump(_number(estimate, "gyro_jump_s"), (x, y, z), (sigma_x, sigma_y, sigma_z)),)


def _number(estimate: Estimate, name: str) -> float:
    value = estimate.quality.get(name, 0.0)
    return value if isinstance(value, float | int) else 0.0


def aided_by(estimate: Estimate) -> str:
    """Return the aids beside gyro and accelerometer in words: ``GNSS, barometer and magnetometer``."""
    words = {"gnss": "GNSS", "baro": "barometer", "mag": "magnetometer", "rest": "rest"}
    names = [words.get(w, w) for w in _aids(estimate)]
    return " and ".join(x for x in (", ".join(names[:-1]), *names[-1:]) if x) or "gravity alone"


def _aids(estimate: Estimate) -> list[str]:
    return str(estimate.quality.get("aided_by", "")).split()


def thin(estimate: Estimate) -> tuple[Array, Array, NDArray[np.int64], Array, Array]:
    """Return a smoother's output at MAX_REFERENCE_HZ or more.

    Times (n,) s, attitudes (n, 4), segments (n,) between restarts, sigmas (n,) in deg of tilt and heading.
    """
    t = np.asarray(estimate.t, np.float64)
    step = max(1, int(1.01 * model.sample_rate(t) / MAX_REFERENCE_HZ))
    segment = np.zeros(len(t), np.int64) if estimate.segment is None else np.asarray(estimate.segment, np.int64)
    sigma = [
        np.degrees(np.asarray(estimate.aux[n], np.float64).reshape(len(t))) for n in ("sigma_tilt", "sigma_heading")
    ]
    if not {"gnss", "mag"} & set(_aids(estimate)):
        sigma[1] = np.full(len(t), 180.0)  # without compass and GNSS its north is unknown
    return t[::step], rotation.normalize(estimate.q[::step]), segment[::step], sigma[0][::step], sigma[1][::step]


def sigma_deg(reference: Reference, angle: str, inside: NDArray[np.bool_] | None = None) -> float:
    """Return the RMS sigma of a reference in deg.

    Over the samples ``inside`` (n,), by default the scored ones. ``angle``: tilt, heading or total. 0 if unknown, NaN
    without samples.
    """
    if reference.sigma is None:
        return 0.0
    tilt, heading = reference.sigma.tilt_deg, reference.sigma.heading_deg
    heading = heading if reference.heading.by in ("own", "relative") else np.zeros_like(heading)
    squares = {"tilt": tilt**2, "heading": heading**2, "total": tilt**2 + heading**2}[angle]
    used = squares[scoring.scored_mask(reference, reference.t) if inside is None else inside]
    return float(np.sqrt(np.mean(used))) if len(used) else float("nan")


def differences_deg(reference: Reference, t: Array, q: Array) -> tuple[Array, Array]:
    """Return tilt and signed heading errors in deg of attitudes (n, 4)."""
    own, _ = interpolate_attitudes(reference.t, reference.q, reference.gap_segment, t)
    e = rotation.earth_error(q, own)
    return np.degrees(rotation.tilt_angle(e)), np.degrees(rotation.heading_angle(e))


def unsure_of_tilt(reference: Reference) -> str:
    """Return why a smoother's tilt sigma is too large; empty if small."""
    own = sigma_deg(reference, "tilt")
    return "" if own <= MAX_SIGMA_DEG else f"own tilt sigma {own:.1f} deg; up to {MAX_SIGMA_DEG:.0f} deg is a reference"


def sure_of_heading(reference: Reference) -> bool:
    """Return whether the heading sigma allows a comparison of headings."""
    return sigma_deg(reference, "heading") <= MAX_SIGMA_DEG


def with_true_heading(reference: Reference, heading: Stream) -> Reference:
    """Return the smoother turned to an external heading (n, 1) rad.

    Turned about the vertical by the running mean of the difference; the scatter about that mean is the new sigma.
    UsageError without common time.
    """
    t = heading.t_best
    own, _ = interpolate_attitudes(reference.t, reference.q, reference.gap_segment, t)
    off = rotation.wrap(heading.x[:, 0] - rotation.to_euler(own)[:, 2])
    known = np.isfinite(off)
    if np.count_nonzero(known) < 2:
        raise UsageError(f"{heading.source} and the smoother share no time")
    t, off = t[known], off[known]
    turned, scatter = np.zeros(len(reference.t)), np.zeros(len(t))
    segment = model.number_segments(t)
    i = np.clip(np.searchsorted(t, reference.t, side="right") - 1, 0, len(t) - 1)
    for part in model.segment_slices(np.ones(len(t), bool), segment):
        mine, along = segment[i] == segment[part.start], np.unwrap(off[part])
        mean = _running_mean(t[part], along)
        scatter[part] = along - mean
        turned[mine] = np.interp(reference.t[mine], t[part], mean)
    sigma = float(np.degrees(np.sqrt(np.mean(scatter**2))))
    text = f"heading of {heading.source} by --truth; it varies by {sigma:.2g} deg about its mean over 2 s"
    step = AlignmentStep("heading_by", text, sigma, "deg", heading.source, option="--truth")
    return replace(
        reference,
        q=rotation.turn_about_down(reference.q, turned),
        sigma=None if reference.sigma is None else replace(reference.sigma, heading_deg=np.full(len(turned), sigma)),
        quality=reference.quality | {"heading_from": "external"},
        alignment=_with_step(reference, step),
    )


def _with_step(reference: Reference, step: AlignmentStep) -> Alignment:
    """Insert a step after those of reference and sigma."""
    steps = reference.alignment.steps
    return replace(reference.alignment, steps=[*steps[:2], step, *steps[2:]])


def with_heading_of(reference: Reference, onboard: Reference | None) -> Reference:
    """Return the smoother turned to the onboard heading, or without heading.

    Turned about the vertical by the running mean of the difference, which keeps the smoother's tilt and steps. Segments
    end at the resets of the onboard attitude, scoring begins with its alignment. A smoother with a small heading sigma
    is returned unchanged.
    """
    if sure_of_heading(reference):
        return reference
    own = sigma_deg(reference, "heading")
    why = f"the smoother's own heading sigma is {own:.1f} deg"
    if not own < UNKNOWN_HEADING_DEG:
        why = "neither compass nor motion shows the smoother a heading that stands"
    step = AlignmentStep("heading_by", f"{why}: no heading is compared", source="none")
    heading = np.zeros(0) if onboard is None else differences_deg(reference, onboard.t, onboard.q)[1]
    known = np.isfinite(heading)
    if onboard is None or np.count_nonzero(known) < 2:
        return replace(reference, heading=HeadingOrigin("none", why), alignment=_with_step(reference, step))
    t, segment = onboard.t[known], onboard.segment[known]
    off = np.radians(heading[known])
    turned = np.zeros(len(reference.t))
    i = np.clip(np.searchsorted(t, reference.t, side="right") - 1, 0, len(t) - 1)
    for part in model.segment_slices(np.ones(len(t), bool), segment):
        mine = segment[i] == segment[part.start]
        turned[mine] = np.interp(reference.t[mine], t[part], _running_mean(t[part], np.unwrap(off[part])))
    step = replace(step, text=f"{why}: heading and its errors are against {onboard.source}", source=onboard.source)
    return replace(
        reference,
        q=rotation.turn_about_down(reference.q, turned),
        segment=model.merge_numbers(reference.segment, segment[i]),
        scoring=replace(reference.scoring, unscored=onboard.scoring.unscored),
        heading=HeadingOrigin("onboard", why),
        alignment=_with_step(reference, step),
    )


def _running_mean(t: Array, x: Array) -> Array:
    """Return the running mean (n,) of ``x`` over HEADING_MEAN_S around each of its times."""
    low = np.searchsorted(t, t - 0.5 * HEADING_MEAN_S)
    high = np.searchsorted(t, t + 0.5 * HEADING_MEAN_S, "right")
    total = np.concatenate([[0.0], np.cumsum(x)])
    mean: Array = (total[high] - total[low]) / (high - low)
    return mean


# Descriptions of a reference: what agreement proves, and its own sigma.


def meaning(ref: Reference) -> str:
    """Return what agreement with a reference proves, in one or two sentences."""
    if ref.kind == "smoother":
        return _smoother_meaning(ref)
    if ref.fit is not None:
        return _external_meaning(ref)
    return {
        "truth": "Truth: errors are errors.",
        "onboard": "The autopilot's own attitude: agreement, not truth.",
        "none": "Nothing to compare with: accuracy and lag have no answer.",
    }[ref.kind]


def own_sigma_deg(ref: Reference, angle: str) -> float | None:
    """Return the RMS sigma of an angle; None if unknown or borrowed."""
    if ref.sigma is None or (angle == "heading" and ref.heading.by not in ("own", "relative")):
        return None
    own = sigma_deg(ref, angle)
    return own if math.isfinite(own) else None


def caveat(ref: Reference) -> str:
    """Return reservations about a ranking by a reference; may be empty.

    Clauses joined by semicolons: doubts, the single source of its heading, why the smoother was refused.
    """
    parts = [_doubt(ref)]
    if ref.kind == "smoother":
        parts.append(_heading_caveat(ref))
    if ref.kind in ("onboard", "none") and SMOOTHER in ref.faults.refused:
        why = ref.faults.refused[SMOOTHER]
        by_sensors = why in (ref.faults.gyro, *(fault.why for fault in ref.faults.sensors.values()))
        why = "its sensors failed a check" if by_sensors else _short(why)  # the check has its own entry
        parts.append(f"the smoother was refused: {why}")
    return "; ".join(part for part in parts if part)


def _doubt(ref: Reference) -> str:
    """Return why the reference in use is in doubt, or empty."""
    why = ref.faults.doubt
    if not why and ref.kind == "smoother" and unsure_of_tilt(ref):
        why = f"its tilt sigma is above {MAX_SIGMA_DEG:.0f} deg"
    return f"the {ref.kind} is in doubt: {_short(why)}" if why else ""


def _short(why: str) -> str:
    """Return the first part of a reason."""
    return why.partition(";")[0].partition(", ")[0]


def _heading_caveat(ref: Reference) -> str:
    """Return the single source of its heading, or why no heading is compared."""
    if ref.heading.by == "none":
        why = str(ref.quality.get("heading_why", "")) if ref.quality.get("heading_from") == "none" else ""
        return f"no heading is compared: {_short(why or ref.heading.why)}"
    one_source = ref.heading.by == "own" and ref.quality.get("heading_from") in ("compass", "motion", "external")
    return heading_words(ref.quality) if one_source else ""


def heading_words(quality: Mapping[str, float | str]) -> str:
    """Return the origin of a smoothed heading as a clause; empty where unknown."""
    found = str(quality.get("heading_from", ""))
    words = {
        "both": "compass and motion agree on the heading",
        "compass": "the heading rests on the compass alone",
        "motion": "the heading is from motion, without the compass",
        "external": "the heading is external",
        "none": f"there is no heading: {quality.get('heading_why', 'nothing shows it')}",
    }
    return words.get(found, "")


def _external_meaning(ref: Reference) -> str:
    tilt, heading = (own_sigma_deg(ref, angle) or 0.0 for angle in ("tilt", "heading"))
    north = "" if ref.heading.by == "own" else " Its north is unknown: only changes of heading are compared."
    return (
        f"External truth ({ref.source}): differences are errors beyond its own sigma, {tilt:.2g} deg in tilt, "
        f"{heading:.2g} deg in heading.{north}"
    )


def _smoother_meaning(ref: Reference) -> str:
    tilt, heading = (own_sigma_deg(ref, angle) or 0.0 for angle in ("tilt", "heading"))
    whose = {
        "own": f"{heading:.2g} deg in heading",
        "onboard": "headings are compared with onboard",
        "none": "headings are not compared",
    }[ref.heading.by]
    words = heading_words(ref.quality)
    if ref.heading.by == "onboard" and ref.quality.get("heading_from") != "none":
        words = ref.heading.why
    rests = f" {words[0].upper()}{words[1:]}." if words else ""
    return (
        "Smoother: an estimate from both sides of each moment, from all sensors of the log, with the same IMU as the "
        "filters and the model of ESKF (without GNSS of MEKF). "
        "Differences below its own sigma, relative to the IMU as mounted, mean nothing: "
        f"{tilt:.2g} deg in tilt, {whose}.{rests}"
    )
