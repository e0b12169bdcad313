"""Rejected aids of the onboard filter: the gate or noise that accepts their samples, and the filter without compass.

Evidence only: a wider gate hides the fault of a sensor.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from attlog.estimators.ekf3 import parameters as ekf3
from attlog.estimators.rerun import innovations
from attlog.flight.model import InnovationTest
from attlog.health import CHECKS, Check
from attlog.health.check import number_text
from attlog.pipeline.onboard_rerun import flown_inputs
from attlog.pipeline.trials import Trials, values_text
from attlog.reference.model import Track

Array = NDArray[np.float64]
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


def _rejected(test: InnovationTest, row: Track, kind: str) -> Array:
    """Return innovations (n, 4) of one kind of channels whose next logged test ratio is above 1."""
    tables = [table for name, table in innovations(row.aux).items() if name.partition("_")[0] == kind]
    table = np.concatenate([np.zeros((0, 4)), *tables])
    k = np.searchsorted(test.t, table[:, 0])
    above = (k < len(test.t)) & (test.ratio[np.minimum(k, len(test.t) - 1)] > 1.0)
    return np.asarray(table[above & np.isfinite(table).all(axis=1)])


def explain_rejection(trials: Trials, check: Check, checks: Sequence[Check]) -> list[str]:
    """Return sentences on the gate or noise that accepts the rejected samples, and on the filter without compass."""
    case, log, name = trials.case, trials.case.log, trials.estimator.name
    test = next((x for x in log.estimator.innovation_tests if check.sensor == f"EKF {x.aid}"), None)
    if test is None:
        return []
    use = case.segments.mask(test.t, "airborne") & np.isfinite(test.ratio)
    test = replace(test, t=test.t[use], ratio=test.ratio[use])
    if not len(test.t):
        return []
    tables = {kind: _rejected(test, trials.row, kind) for kind in AID_CHANNELS[test.aid] if kind in GATES[name]}
    kind, table = max(tables.items(), key=lambda item: float(item[1][:, 3].max(initial=0.0)))
    if table[:, 3].max(initial=0.0) <= 1.0:
        return []
    options = _accepting(trials, kind, table)
    if not options:
        return [f"In the re-run no allowed gate of {trials.title} accepts the rejected {kind} samples."]
    sentences = []
    for parameter, value in options:
        shown, _, row = trials.run({parameter: value})
        share = 100.0 * float(np.mean(_rejected(test, row, kind)[:, 3] <= 1.0))
        accepts = f"accepts {'them' if share == 100.0 else f'{share:.0f} % of them'}"
        tried = f"{parameter} {number_text(value)} (was {log.param(parameter):g})"
        sentences.append(f"{trials.title} run again with {tried} {accepts}: {shown}.")
    if test.aid == "compass":
        if any(c.is_trouble and c.in_use and c is not check and CHECKS[c.question].kind == "compass" for c in checks):
            sentences.append("The compass is at fault: a wider gate only hides it.")
        if without := _without_compass(trials):
            shown = trials.run(without)[0]
            sentences.append(f"{trials.title} run again without its compass ({values_text(without)}): {shown}.")
    return sentences


def _accepting(trials: Trials, kind: str, table: Array) -> list[tuple[str, float]]:
    """Return gate and noise that accept the rejected samples, each alone, where documented ranges allow them.

    The gate grows by the root of the largest ratio. The noise r replaces the flown one in the variance:
    e^2 = gate^2 (variance - r_flown^2 + r^2) at the largest sample.
    """
    log, name = trials.case.log, trials.estimator.name
    gate, noise = GATES[name][kind]
    high = {p.name: p.high for p in trials.estimator.parameters}
    old_gate, old_noise = log.param(gate), log.param(noise) if noise else None
    if old_gate is None:
        return []
    found = [(gate, _rounded_up(float(old_gate) * math.sqrt(float(table[:, 3].max()))))]
    if old_noise is not None:
        _, e, variance, _ = table.T
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
    inputs = flown_inputs(trials.case, trials.imu)
    return {"EK3_SRC1_YAW": 8.0} if inputs.version >= ekf3.SOURCES and len(inputs.gsf["t"]) else {}
