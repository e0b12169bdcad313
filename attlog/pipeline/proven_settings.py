"""Test proposed settings by running the onboard filter again with them.

The flown filter runs again with the new values: its own parameters (delays, noises, sources), a corrected compass
(offsets, motor field), or the samples of another compass. Its innovations are its own prediction errors and need no
reference. A setting that makes an aid's innovations significantly larger, and none smaller, is not offered. A rejected
aid carries the gate and the noise that accept its samples, as evidence only.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog import estimators
from attlog.core import rotation
from attlog.core.errors import UsageError
from attlog.estimators.ekf3 import parameters as ekf3
from attlog.estimators.interface import Estimator
from attlog.estimators.rerun import innovations
from attlog.flight.model import Imu, InnovationTest, Mag
from attlog.flight.recalibration import COMPASS_PARAMETERS, recorrected_units
from attlog.health import CHECKS, Check, Setting
from attlog.health.check import number_text
from attlog.metrics.metric import Answer, Case
from attlog.metrics.rerun import AID_GROUPS, compute_innovations
from attlog.metrics.statistics import student
from attlog.pipeline.onboard_rerun import GAUSS_PER_TESLA, flown_filter, inputs_of, rerun_row
from attlog.reference.model import Track

Array = NDArray[np.float64]
RMS, RATIO = "innovation_rms", "test_ratio_rms"
# Aids in sentences. GNSS comes first, because it is independent of the compass.
AIDS = ("gnss_velocity", "gnss_position", "compass_heading", "compass_field", "height")
# Smaller relative changes of an RMS are not reported.
MIN_CHANGE = 0.02
# Aids named in one sentence.
MAX_SHOWN = 3
MIN_BLOCKS = 3
FILTER_TITLES = {"px4_ekf2": "EKF2", "ap_ekf3": "EKF3"}
# Compass that an action selects.
USED_INSTEAD = re.compile(r"\b[Uu]se (\S+?)(?: instead|\.$)")


@dataclass(frozen=True, slots=True)
class Trials:
    """Re-runs of the flown filter of a log: as it flew (``row``), and with changes.

    ``before``: statistics of the innovations as it flew.
    """

    case: Case
    imu: Imu
    estimator: Estimator
    row: Track
    before: Mapping[str, Answer]

    @property
    def title(self) -> str:
        """The filter's name in sentences."""
        return FILTER_TITLES[self.estimator.name]

    def run(self, changes: Mapping[str, float], field_error_ut: Array | None = None) -> tuple[str, bool, Track]:
        """Run again with changed parameters, and with a field (n, 3) subtracted from the compass.

        Returns the changes of innovations in words, whether the filter predicts worse, and the re-run.
        """
        spec = estimators.EstimatorSpec(self.estimator, params=dict(changes))
        row = rerun_row(self.case, self.imu, spec, self.estimator.name, field_error_ut)[0]
        before, after = self.before, compute_innovations(self.case, row, "airborne")
        sizes = [_change(before, after, aid) for aid in AIDS if f"{RMS}.{aid}" in before and f"{RMS}.{aid}" in after]
        shown = "; ".join([text for text, _ in sizes if text][:MAX_SHOWN]) or "no innovation changes by 2 %"
        better, worse = (any(sign == wanted for _, sign in sizes) for wanted in (-1, 1))
        return shown, worse and not better, row


def prove_settings(case: Case, checks: list[Check]) -> list[Check]:
    """Add innovations before and after to each check with settings; drop harmful settings.

    Checks without settings of the filter, and checks of logs that cannot be run again, are returned unchanged.
    """
    name, imu = flown_filter(case.log), case.log.replay_imu
    if not name or imu is None:
        return checks
    estimator = estimators.get(name)
    concerned = [_is_concerned(check, estimator) for check in checks]
    if not any(concerned):
        return checks
    try:
        flown = rerun_row(case, imu, estimators.EstimatorSpec(estimator), name)[0]
    except UsageError:
        return checks
    if flown.reproduction is None or not flown.reproduction.follows:
        return checks
    trials = Trials(case, imu, estimator, flown, compute_innovations(case, flown, "airborne"))
    return [_proven(trials, c, checks) if tried else c for c, tried in zip(checks, concerned, strict=True)]


def _is_concerned(check: Check, estimator: Estimator) -> bool:
    """Return whether a check of a sensor in use offers inputs of the filter, or reports a rejected aid."""
    offered = _changes(check, estimator) or _is_compass(check.settings) or USED_INSTEAD.search(check.action)
    rejected = check.question == "innovations" and check.is_trouble and check.t is not None
    return check.in_use and bool(offered or rejected)


def _changes(check: Check, estimator: Estimator) -> dict[str, float]:
    """Return a check's settings by the filter's names, empty unless all are known."""
    known = {p.name for p in estimator.parameters}
    wanted = {estimator.aliases.get(s.name, s.name): s.new for s in check.settings}
    return wanted if set(wanted) <= known else {}


def _is_compass(settings: Sequence[Setting]) -> bool:
    """Return whether all settings calibrate a compass."""
    return bool(settings) and all(COMPASS_PARAMETERS.fullmatch(s.name) for s in settings)


def _proven(trials: Trials, check: Check, checks: Sequence[Check]) -> Check:
    """Return a check with the re-run of what it offers, else of its rejected aid."""
    changes, error = _changes(check, trials.estimator), None
    tried = _words({s.name: s.new for s in check.settings})
    if not changes:
        offered = _offered_field(trials, check, checks)
        if offered is None:
            return replace(check, evidence=[*check.evidence, *_acceptance(trials, check, checks)])
        error, tried = offered
    shown, worse, _ = trials.run(changes, error)
    if worse:
        why = f"Not offered: run again with {tried}, {trials.title} predicts worse: {shown}."
        return replace(check, settings=[], action="", why_no_setting=why)
    return replace(check, evidence=[*check.evidence, f"{trials.title} run again with {tried}: {shown}."])


def _inputs(trials: Trials) -> Any:
    return inputs_of(trials.case, str(trials.imu.index) if trials.case.log.firmware.name == "ArduPilot" else "")


# Another field at the compass.


def _offered_field(trials: Trials, check: Check, checks: Sequence[Check]) -> tuple[Array, str] | None:
    """Return the field (n, 3) uT that a check's offer takes off the filter's samples, and the offer in words.

    None where the check offers neither a calibration nor another compass, or where the flown calibration is unknown.
    """
    log = trials.case.log
    used = log.mags[log.mag or 0]
    named = USED_INSTEAD.search(check.action)
    mag = next((m for m in log.mags if named and m.field.source == named[1]), used)
    wanted = check.settings if mag is used else _settings_of(mag, check, checks)
    values = {s.name: s.new for s in wanted} if _is_compass(wanted) else {}
    corrected = recorrected_units(log, "", values, trials.imu, mag)[1] if values else mag
    if corrected is None or corrected is used or (values and corrected is mag):
        return None
    inputs = _inputs(trials)
    t = inputs.mag["t"] - log.t0_us * 1e-6
    error = (
        _at(t, used.field.t_best, used.field.x - corrected.field.x)
        if mag is used
        else (inputs.mag["x"] / GAUSS_PER_TESLA - _at(t, corrected.field.t_best, corrected.field.x))
    )
    words = _words(values)
    if mag is not used:
        words = f"the samples of {mag.field.source}{f' and {words}' if words else ''}"
    return 1e6 * error, words


def _settings_of(mag: Mag, check: Check, checks: Sequence[Check]) -> list[Setting]:
    """Return the settings that the same question offers for another compass."""
    same = (c for c in checks if c.question == check.question and c.sensor == mag.field.source)
    return next((c.settings for c in same if c.settings), [])


def _at(t: Array, stamps: Array, x: Array) -> Array:
    """Interpolate vectors (n, 3) at ``stamps`` to ``t``, without missing ones."""
    known = rotation.finite_rows(x) & np.isfinite(stamps)
    return np.column_stack([np.interp(t, stamps[known], axis[known]) for axis in x.T])


# Rejected aids.

# Kinds of channels of an aid's innovations, the beginnings of their names.
AID_CHANNELS = {
    "compass": ("mag", "heading"),
    "velocity": ("velocity",),
    "position": ("position",),
    "height": ("baro", "gnss"),
    "airspeed": ("airspeed",),
}
# Gate and noise by kind of channel. The noise of GNSS is a lower bound of the receiver's own accuracy: not proposed.
GATES: Mapping[str, Mapping[str, tuple[str, str]]] = {
    "px4_ekf2": {
        "mag": ("EKF2_MAG_GATE", "EKF2_MAG_NOISE"),
        "heading": ("EKF2_HDG_GATE", "EKF2_HEAD_NOISE"),
        "velocity": ("EKF2_GPS_V_GATE", ""),
        "position": ("EKF2_GPS_P_GATE", ""),
        "baro": ("EKF2_BARO_GATE", "EKF2_BARO_NOISE"),
        "airspeed": ("EKF2_TAS_GATE", "EKF2_EAS_NOISE"),
    },
    "ap_ekf3": {
        "mag": ("EK3_MAG_I_GATE", "EK3_MAG_M_NSE"),
        "heading": ("EK3_YAW_I_GATE", "EK3_YAW_M_NSE"),
        "velocity": ("EK3_VEL_I_GATE", ""),
        "position": ("EK3_POS_I_GATE", ""),
        "baro": ("EK3_HGT_I_GATE", "EK3_ALT_M_NSE"),
        "airspeed": ("EK3_EAS_I_GATE", "EK3_EAS_M_NSE"),
    },
}
# Unit of the gates in standard deviations.
GATE_SIGMAS = {"px4_ekf2": 1.0, "ap_ekf3": 0.01}


@dataclass(frozen=True, slots=True)
class RejectedSamples:
    """Innovations ``table`` (n, 4) of one ``kind`` of channels at times when the log's test ratio was above 1."""

    kind: str
    table: Array

    @property
    def largest(self) -> float:
        """Largest test ratio, squared as the filter computes it."""
        return float(self.table[:, 3].max(initial=0.0))


def _rejected(test: InnovationTest, row: Track, kind: str) -> RejectedSamples:
    """Return the innovations of one kind of channels whose next logged test ratio is above 1."""
    tables = [table for name, table in innovations(row.aux).items() if name.partition("_")[0] == kind]
    table = np.concatenate([np.zeros((0, 4)), *tables])
    k = np.searchsorted(test.t, table[:, 0])
    above = (k < len(test.t)) & (test.ratio[np.minimum(k, len(test.t) - 1)] > 1.0)
    return RejectedSamples(kind, table[above & np.isfinite(table).all(axis=1)])


def _acceptance(trials: Trials, check: Check, checks: Sequence[Check]) -> list[str]:
    """Return sentences on the gate or noise that accepts the rejected samples, and on the filter without compass."""
    case, log, name = trials.case, trials.case.log, trials.estimator.name
    test = next((test for test in log.estimator.innovation_tests if test.source == check.sensor), None)
    if test is None:
        return []
    use = case.segments.mask(test.t, "airborne") & np.isfinite(test.ratio)
    test = replace(test, t=test.t[use], ratio=test.ratio[use])
    if not len(test.t):
        return []
    kinds = [kind for kind in AID_CHANNELS[test.aid] if kind in GATES[name]]
    found = max((_rejected(test, trials.row, kind) for kind in kinds), key=lambda rejected: rejected.largest)
    if found.largest <= 1.0:
        return []
    options = _accepting(trials, found)
    if not options:
        return [f"In the re-run no allowed gate of {trials.title} accepts the rejected {found.kind} samples."]
    sentences = []
    for parameter, value in options:
        shown, _, row = trials.run({parameter: value})
        share = 100.0 * float(np.mean(_rejected(test, row, found.kind).table[:, 3] <= 1.0))
        accepts = f"accepts {'them' if share == 100.0 else f'{share:.0f} % of them'}"
        tried = f"{parameter} {number_text(value)} (was {log.param(parameter):g})"
        sentences.append(f"{trials.title} run again with {tried} {accepts}: {shown}.")
    if test.aid == "compass":
        if any(c.is_trouble and c.in_use and c is not check and CHECKS[c.question].kind == "compass" for c in checks):
            sentences.append("The compass is at fault: a wider gate only hides it.")
        if without := _without_compass(trials):
            shown = trials.run(without)[0]
            sentences.append(f"{trials.title} run again without its compass ({_words(without)}): {shown}.")
    return sentences


def _accepting(trials: Trials, rejected: RejectedSamples) -> list[tuple[str, float]]:
    """Return gate and noise that accept the rejected samples, each alone, where documented ranges allow them.

    The gate grows by the root of the largest ratio. The noise r replaces the flown one in the variance:
    e^2 = gate^2 (variance - r_flown^2 + r^2) at the largest sample.
    """
    log, name = trials.case.log, trials.estimator.name
    gate, noise = GATES[name][rejected.kind]
    high = {p.name: p.high for p in trials.estimator.parameters}
    old_gate, old_noise = log.param(gate), log.param(noise) if noise else None
    if old_gate is None:
        return []
    found = [(gate, _rounded_up(float(old_gate) * math.sqrt(rejected.largest)))]
    if old_noise is not None:
        _, e, variance, _ = rejected.table.T
        needed = np.max((e / (float(old_gate) * GATE_SIGMAS[name])) ** 2 - variance) + float(old_noise) ** 2
        found.append((noise, _rounded_up(math.sqrt(max(needed, float(old_noise) ** 2)))))
    return [(parameter, value) for parameter, value in found if value <= high[parameter]]


def _rounded_up(value: float) -> float:
    """Round up to two significant digits."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / step - 1e-9) * step:.2g}")


def _without_compass(trials: Trials) -> dict[str, float]:
    """Return the parameters that switch the compass off; empty where the re-run has no other heading."""
    if trials.estimator.name == "px4_ekf2":
        return {"EKF2_MAG_TYPE": 5.0}
    inputs = _inputs(trials)
    return {"EK3_SRC1_YAW": 8.0} if inputs.version >= ekf3.SOURCES and len(inputs.gsf["t"]) else {}


def _words(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {number_text(value)}" for name, value in values.items())


def _change(before: Mapping[str, Answer], after: Mapping[str, Answer], aid: str) -> tuple[str, int]:
    """Describe the change of an aid's innovations, with its sign if significant.

    The text is empty and the sign 0 for a small change.
    """
    one, two = before[f"{RMS}.{aid}"], after[f"{RMS}.{aid}"]
    if not one.value or two.value is None or abs(two.value / one.value - 1.0) < MIN_CHANGE:
        return "", 0
    group, sizes = AID_GROUPS[aid], [_figures(x, 2) for x in (one.value, two.value)]
    if sizes[0] == sizes[1]:
        sizes = [_figures(x, 3) for x in (one.value, two.value)]
    text = f"{group.title} innovation {sizes[0]} to {sizes[1]} {group.unit}"
    ratios = [answers[f"{RATIO}.{aid}"].value for answers in (before, after)]
    if aid.startswith("compass") and all(ratios):
        text += f", ratio {ratios[0]:.2g} to {ratios[1]:.2g}"
    sign = _significant_sign(one, two)
    return text, sign if sign * (two.value - one.value) > 0.0 else 0


def _figures(value: float, digits: int) -> str:
    """Format a number with so many significant digits, whole from 100 on."""
    return f"{value:.0f}" if value >= 100.0 else f"{value:.{digits}g}"


def _significant_sign(one: Answer, two: Answer) -> int:
    """Return the sign of the mean log ratio of blocks' mean squares, 0 if not significant at 95 %.

    Ratios, because innovations of a manoeuvre outweigh those of all other blocks in a difference.
    """
    if one.units is None or two.units is None:
        return 0
    _, i, j = np.intersect1d(one.units.ids, two.units.ids, return_indices=True)
    before, after = one.units.values[i], two.units.values[j]
    use = (before > 0.0) & (after > 0.0)
    change, n = np.log(after[use] / before[use]), int(use.sum())
    if n < MIN_BLOCKS:
        return 0
    mean, half = float(np.mean(change)), student(0.975, n - 1) * float(np.std(change, ddof=1)) / math.sqrt(n)
    return int(np.sign(mean)) if abs(mean) > half else 0
