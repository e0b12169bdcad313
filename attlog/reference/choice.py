"""Choice of the reference: truth, else smoother, else onboard attitude, else none."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.core.errors import AttlogError, UsageError
from attlog.core.sorting import is_in
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
from attlog.reference.model import (
    SMOOTHER,
    Alignment,
    AlignmentStep,
    Faults,
    HeadingOrigin,
    Reference,
    ReferenceOptions,
    ReferenceSigma,
)
from attlog.segments import Segments, increments, model

Array = NDArray[np.float64]
Kind = Literal["truth", "smoother", "onboard"]
# Runs the smoother over the log; raises AttlogError with the reason if it cannot.
Smooth = Callable[[], Estimate]

# Slower references resolve no lag.
MIN_LAG_HZ = 5.0
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
    """Return the aligned reference of a log with its faults.

    ``smooth`` runs the smoother and is called only if needed; None: no smoother. ``refused``: reasons by attitude that
    filters have contradicted since; ``second``: the smoother that replaces it. ``heading``: whether headings are
    compared; otherwise a wrong onboard heading is no reason to refuse the attitude. UsageError for an option that names
    something the log lacks.

    Refused unless requested: an attitude off gravity by more than 10 deg; a smoother that gravity contradicts at
    standstill, or with a large tilt sigma beside a sound onboard attitude; an onboard attitude whose heading GNSS
    acceleration contradicts. No smoother is run with a gyro or another sensor that physics contradicts.
    """
    return _Choice(log, segments, options or ReferenceOptions(), smooth, refused or {}).choose(second, heading)


class _Choice:
    """Choice among the attitudes of one log."""

    def __init__(
        self,
        log: FlightLog,
        segments: Segments,
        options: ReferenceOptions,
        smooth: Smooth | None,
        refused: Mapping[str, str],
    ) -> None:
        if options.clock not in ("sample", "publication"):
            raise UsageError(f"clock {options.clock!r}: use sample or publication")
        self.log, self.segments, self.options, self.smooth = log, segments, options, smooth
        self.kind = _wanted_kind(options.reference)
        if self.kind == "auto" and log.truth is not None and log.truth.fit is not None:
            self.kind = "truth"  # the user's external truth is used in spite of contradictions
        if self.kind == "auto" and log.true_heading is not None and smooth is not None:
            self.kind = SMOOTHER
        what = "Whether attitudes turn as the gyro does"
        self.mismatches = guarded_part(log, what, self._gyro_mismatches, dict[str, gyro_checks.GyroMismatch])
        gyro = next((m.why for m in self.mismatches.values() if m.of == "gyro"), "")
        self.refused = dict(refused)
        self.faults = Faults(gyro=gyro, sensors=sensor_faults.find_sensor_faults(log, segments))

    def choose(self, second: Reference | None, heading: bool) -> Reference:
        """Return the requested reference, else the best one."""
        found = self._asked() if self.kind != "auto" else self._best(second, heading)
        known = self.faults
        found.faults.gyro, found.faults.sensors, found.faults.onboard_heading = (
            known.gyro,
            known.sensors,
            known.onboard_heading,
        )
        return found

    def _best(self, second: Reference | None, heading: bool) -> Reference:
        """Return the first uncontradicted of truth, smoother and onboard attitude."""
        log, out = self.log, self.refused
        out |= {name: m.why for name, m in self.mismatches.items() if m.of == "attitude"}
        misled = self.faults.gyro or next((f.why for f in self.faults.sensors.values() if f.misleads), "")
        out |= {SMOOTHER: misled} if misled else {}
        wrong_heading = guarded_part(
            log, "The heading by GNSS", lambda: heading_sources.wrong_onboard_heading(log, self.segments), str
        )
        self.faults.onboard_heading = wrong_heading
        truth = self._unless_refused("truth", self._truth)
        if truth is not None:
            return truth
        smoother = self._sound_smoother(second)
        unsure = "" if smoother is None else smoothed.unsure_of_tilt(smoother)
        if smoother is not None and smoother is not second:
            smoother.scoring.unscored = [*smoother.scoring.unscored, *smoother.scoring.refuted]
        if smoother is not None and not unsure:
            smoother.faults.onboard = wrong_heading or onboard_check.onboard_error(log, self.segments, smoother)
            if smoothed.sure_of_heading(smoother):
                return self._taken(smoother)
        onboard = self._unless_refused("onboard", self._onboard, wrong_heading if heading else "")
        # with a small tilt sigma alone a smoother borrows a sound heading; with a large one onboard takes precedence
        if smoother is not None and (onboard is None or not unsure):
            lender = None if smoother.faults.onboard else onboard
            return self._taken(smoothed.with_heading_of(smoother, lender))
        if onboard is not None:
            onboard.second = smoother
            if wrong_heading:
                onboard.heading = HeadingOrigin("none", wrong_heading)
            if unsure:
                out[SMOOTHER] = unsure
            return self._taken(onboard)
        return self._nothing()

    def _unless_refused(self, name: str, make: Callable[[], Reference | None], wrong: str = "") -> Reference | None:
        """Return an attitude unless it is refused, ``wrong``, or contradicted by gravity.

        Gravity is ignored where the accelerometer's axes are wrong.
        """
        found = None if name in self.refused else make()
        if found is None:
            return None
        if sensor_faults.FRAME in self.faults.sensors:
            found.faults.reference = ""
        why = wrong or found.faults.reference
        if why:
            self.refused[name] = why
        return None if why else found

    def _sound_smoother(self, second: Reference | None) -> Reference | None:
        """Return ``second``, else run the smoother; None if it is refused."""
        if second is not None:
            return second
        if self.smooth is None or SMOOTHER in self.refused:
            return None
        found = self._smoothed(self.smooth)
        why = found if isinstance(found, str) else self._contradiction(found)
        if why or isinstance(found, str):
            self.refused[SMOOTHER] = why
            return None
        return found

    def _contradiction(self, smoother: Reference) -> str:
        """Return why gravity, or the gyro at rest, contradicts a whole smoother; empty if neither does."""
        imu, jumps = self.log.replay_imu, smoother.gyro_jumps
        stepped = gyro_checks.contradicted_at_rest(imu, self.segments, jumps) if imu is not None and jumps else ""
        return smoother.faults.reference or stepped or self._off_gravity(smoother)

    def _off_gravity(self, smoother: Reference) -> str:
        """Return why gravity contradicts a whole smoother; empty if it does not.

        Sets the contradicted spans as ``scoring.refuted``.
        """
        found = reference_checks.static_tilt(self.log, smoother, self.log.onboard_attitude)
        if found is None:
            return ""
        why, smoother.scoring.refuted = reference_checks.static_tilt_refusal(found, smoother, self._onboard_name)
        if smoother.scoring.refuted and not why:
            text = "standing still it is off gravity for so long in all: nothing is scored there"
            seconds = sum(b - a for a, b in smoother.scoring.refuted)
            step = AlignmentStep("gravity_at_standstill", text, seconds, "s", "the accelerometer")
            smoother.alignment.steps.append(step)
        return why

    def _taken(self, reference: Reference) -> Reference:
        """Add the refused attitudes to the text of the first alignment step."""
        why_not = "".join(f"; {name} refused: {why}" for name, why in self.refused.items())
        reference.faults.refused = self.refused
        steps = reference.alignment.steps
        steps[0] = replace(steps[0], text=steps[0].text + why_not)
        return reference

    def _nothing(self) -> Reference:
        """Return no reference, with a fault if physics contradicted an attitude."""
        fault = next((why for kind, why in self.refused.items() if kind != SMOOTHER), "")
        doubt = self.refused.get(SMOOTHER, "")
        why = (fault or NO_ATTITUDE) + (f"; smoother refused: {doubt}" if doubt else "")
        nothing = no_reference(self.log, self.segments, self.options, why)
        nothing.faults.reference, nothing.faults.refused = fault, self.refused
        return nothing

    def _asked(self) -> Reference:
        """Return the requested reference, even if contradicted; UsageError if it is missing."""
        log, kind, named = self.log, self.kind, self.options.reference.partition(":")[2]
        if kind == "none":
            return no_reference(log, self.segments, self.options, "no reference, as asked")
        found: Reference | str | None
        if kind == "smoother":
            found = "it was not run" if self.smooth is None else self._smoothed(self.smooth)
            missing = f"{log.path.name}: {found}"
        elif kind == "truth":
            found, missing = self._truth(), f"{log.path.name} holds no truth; it has {_known_attitudes(log)}"
        else:
            if named and named not in log.attitudes:
                known = _known_attitudes(log)
                raise UsageError(f"reference {self.options.reference!r}: {log.path.name} holds {known}")
            found, missing = self._onboard(named), f"{log.path.name} holds no onboard attitude"
        if found is None or isinstance(found, str):
            raise UsageError(f"reference {kind}: {missing}")
        found.faults.doubt = found.faults.doubt or self._doubt(found)
        if log.true_heading is not None and kind == SMOOTHER:
            found = smoothed.with_true_heading(found, log.true_heading)
        return found

    def _doubt(self, asked: Reference) -> str:
        """Return why the automatic choice would refuse a requested reference."""
        if asked.kind == "smoother":
            found = reference_checks.static_tilt(self.log, asked, self.log.onboard_attitude)
            return "" if found is None else reference_checks.static_tilt_refusal(found, asked, self._onboard_name)[0]
        if asked.faults.reference:
            return asked.faults.reference
        mismatch = self.mismatches.get(asked.kind)
        if mismatch is not None and mismatch.of == "attitude":
            return mismatch.why
        flew = asked.kind == "onboard" and asked.name == self.log.onboard
        return heading_sources.wrong_onboard_heading(self.log, self.segments) if flew else ""

    def _gyro_mismatches(self) -> dict[str, gyro_checks.GyroMismatch]:
        """Compare truth and the onboard attitude with the replayed gyro."""
        log, imu = self.log, self.log.replay_imu
        mag = None if log.mag is None else log.mags[log.mag]
        found: dict[str, gyro_checks.GyroMismatch] = {}
        for name, attitude in (("truth", log.truth), ("onboard", log.onboard_attitude)):
            if imu is not None and attitude is not None:
                onboard = attitude is log.onboard_attitude
                known = increments.known_resets(log, log.onboard or "", self.segments) if onboard else None
                jumps, _ = known or increments.find_resets(attitude, imu)
                found[name] = gyro_checks.gyro_consistency(imu, attitude, jumps, mag)
        return found

    @property
    def _onboard_name(self) -> str:
        return self.log.onboard or "onboard"

    def _truth(self) -> Reference | None:
        """Return the truth as reference; None without usable truth."""
        truth = self.log.truth
        if truth is None or not _is_usable(truth):
            return None
        why = "the log holds the truth" if truth.fit is None else "given by --truth"
        return build_reference(self.log, self.segments, self.options, "truth", "", truth, why)

    def _onboard(self, named: str = "") -> Reference | None:
        """Return the named or default onboard attitude as reference, or None."""
        log, name = self.log, named or self.log.onboard or ""
        attitude = log.attitudes.get(name)
        if attitude is None or not (named or _is_usable(attitude)):
            return None
        why = "as asked" if named else log.choices.get("onboard", "the onboard attitude")
        return build_reference(log, self.segments, self.options, "onboard", name, attitude, why)

    def _smoothed(self, smooth: Smooth) -> Reference | str:
        """Return the smoother with its sigma, or why it is unusable.

        A requested smoother with a sigma is kept in spite of failed checks, which become its doubt.
        """
        auto = self.options.reference == "auto"
        try:
            estimate = smooth()
        except AttlogError as error:
            return str(error)
        failed = smoothed.reason_unusable(estimate)
        if failed and (auto or not smoothed.has_sigma(estimate)):
            return failed
        t, q, segment, tilt, heading = smoothed.thin(estimate)
        why = f"own estimate from both sides of each moment, aided by {smoothed.aided_by(estimate)}"
        reference = build_reference(
            self.log, self.segments, self.options, "smoother", "", Attitude(t, q, "the smoother"), why, segment
        )
        used = is_in(t, reference.t)
        reference.sigma = ReferenceSigma(tilt[used], heading[used])
        reference.gyro_jumps = smoothed.gyro_jumps(estimate)
        reference.quality, reference.faults.doubt = dict(estimate.quality), failed
        own = [smoothed.sigma_deg(reference, angle) for angle in ("tilt", "heading")]
        if not own[0] <= smoothed.MAX_USABLE_SIGMA_DEG and auto:
            return f"own tilt sigma {own[0]:.1f} deg" if np.isfinite(own[0]) else "none of its attitudes is scored"
        of_heading = f"heading {own[1]:.2f} deg" if own[1] < smoothed.UNKNOWN_HEADING_DEG else "no heading"
        text = f"its own sigma: tilt {own[0]:.2f} deg, {of_heading} (RMS)"
        text += f"; its own checks fail: {failed}" if failed else ""
        reference.alignment.steps.insert(1, AlignmentStep("own_sigma", text, own[0], "deg", "the smoother"))
        return reference


def _wanted_kind(option: str) -> str:
    """Return the requested kind of reference; UsageError for an unknown one."""
    kind, _, named = option.partition(":")
    if kind not in ("auto", "truth", "smoother", "onboard", "none") or (named and kind != "onboard"):
        raise UsageError(f"reference {option!r}: use auto, truth, smoother, onboard, onboard:NAME or none")
    return kind


def _known_attitudes(log: FlightLog) -> str:
    return ", ".join(f"onboard:{name}" for name in log.attitudes) or "no attitude at all"


def _is_usable(attitude: Attitude) -> bool:
    return len(alignment.usable_samples(attitude, "publication")[0]) >= 2


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
    """Return an attitude as aligned reference.

    ``restarts`` (n,): segment numbers of an attitude that has restarts and no resets.
    """
    imu, clock = log.replay_imu, _clock(options)
    t, q, kept = alignment.usable_samples(attitude, clock)
    gap_segment = _gap_segments(t, segments)
    if restarts is not None:
        found, sentences = np.zeros(0, np.int64), list[str]()
        gap_segment = model.merge_numbers(gap_segment, restarts[kept])
    elif kind == "onboard":
        found, sentences = increments.known_resets(log, name, segments)
    else:
        found, sentences = increments.find_resets(attitude, imu)
    jumped = np.zeros(len(attitude.t), np.int64)
    jumped[found] = 1
    segment = model.merge_numbers(gap_segment + np.cumsum(jumped)[kept])
    reference = Reference(kind, attitude.source, t, q, gap_segment, segment, model.sample_rate(t), name)
    aligned = reference.alignment
    aligned.clock = clock
    if attitude.fit is not None:
        alignment.adopt_fit(reference, attitude.fit)
    # a smoother starts in the IMU's axes and is turned to those of the onboard attitude
    axes_of = log.onboard_attitude or attitude if kind == "smoother" else attitude
    aligned.trim, trim_step = alignment.trim_step(log, axes_of, options.trim)
    if kind == "smoother" and aligned.trim is not None:
        reference.q = q = alignment.apply_trim(q, aligned.trim)
    aligned.floor_deg, aligned.step_deg, floor_step = alignment.floor_step(t, q, attitude.step_deg, imu)
    start_step = _set_scoring(reference, _imu_times(imu, t), segments, options)
    start = scoring.aligned_at(attitude, found, segments) if kind == "onboard" else None
    if start is not None:
        reference.scoring.unscored = [(-np.inf, start), *reference.scoring.unscored]
        text = "its own alignment: nothing is compared with it before this jump"
        start_step.append(AlignmentStep("alignment", text, start, "s", attitude.source))
    aligned.declination_deg, north = alignment.declination_step(log, options.declination)
    aligned.input_delay_s, lag = alignment.delay_step(log, imu, reference, options.input_delay)
    reference.faults.reference, gravity_step = reference_checks.gravity_check(reference, imu, segments)
    aligned.steps = [
        AlignmentStep("reference", why, kind, source=attitude.source, option="--reference"),
        alignment.clock_step(log, attitude, clock, kind == "smoother"),
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


def no_reference(log: FlightLog, segments: Segments, options: ReferenceOptions, why: str) -> Reference:
    """Return the reference of kind none, which leaves only metrics at rest."""
    zero, index = np.zeros(0), np.zeros(0, np.int64)
    reference = Reference("none", "", zero, np.zeros((0, 4)), index, index, alignment=Alignment(_clock(options)))
    reference.alignment.declination_deg, north = alignment.declination_step(log, options.declination)
    start = _set_scoring(reference, _imu_times(log.replay_imu, zero), segments, options)
    reference.alignment.steps = [AlignmentStep("reference", why, "none", option="--reference"), north, *start]
    return reference


def _clock(options: ReferenceOptions) -> alignment.Clock:
    return "publication" if options.clock == "publication" else "sample"


def _imu_times(imu: Imu | None, otherwise: Array) -> Array:
    t = otherwise if imu is None else imu.gyro.t_best
    return t[np.isfinite(t)]


def _gap_segments(t: Array, segments: Segments) -> NDArray[np.int64]:
    """Return segment numbers (n,) between gaps of attitude and IMU."""
    starts = np.array([s.t0 for s in segments.of("continuous")][1:])
    return model.merge_numbers(model.number_segments(t), np.searchsorted(starts, t, side="right"))


def _set_scoring(reference: Reference, t: Array, segments: Segments, options: ReferenceOptions) -> list[AlignmentStep]:
    """Set the scored time from IMU times (n,) and return its steps."""
    scored = reference.scoring
    scored.start, scored.unscored = scoring.start_and_unscored(t, options.score_from)
    why = "given by the user"
    if options.score_from is None:
        why = "15 s after the first IMU sample, a third of a log shorter than 30 s"
    if scored.unscored:
        why += f"; {len(scored.unscored)} restarts after gaps, each followed by unscored seconds"
    steps = [AlignmentStep("scoring_start", why, scored.start, "s", "the IMU", option="config: score_from")]
    scored.unscored += [(lost.t0, lost.t1) for lost in segments.of("loss_of_control")]
    impacts = segments.of("impact")
    if impacts:
        scored.end = impacts[0].t0
        steps.append(AlignmentStep("scoring_end", impacts[0].why, scored.end, "s", "impact"))
    return steps


def _resampling_step(reference: Reference) -> AlignmentStep:
    text = f"{reference.rate:.1f} Hz; faster rows are compared at its times, slower ones at their own"
    if reference.rate < MIN_LAG_HZ:
        text += "; too slow for lag, only rest and drift are answered"
    return AlignmentStep("resampling", text, reference.rate, "Hz", reference.source)


def _reset_text(sentences: list[str]) -> str:
    if not sentences:
        return "no reset of this attitude found"
    different = list(dict.fromkeys(sentences))
    count = f"{len(sentences)} reset{'s' if len(sentences) > 1 else ''}"
    return f"{count}, cut out: {'; '.join(different[:3])}{' ...' if len(different) > 3 else ''}"


def _north_steps(log: FlightLog, reference: Reference, north: AlignmentStep) -> list[AlignmentStep]:
    """Return the declination and the one observed with the reference."""
    seen = None if reference.heading.by == "relative" else alignment.observed_declination_deg(log, reference)
    if seen is None:
        return [north]
    text = f"the measured field, turned by {reference.source}, points this far east of its north (median)"
    return [north, AlignmentStep("declination_seen", text, seen, "deg", "the log", False)]
