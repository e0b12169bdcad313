"""Which of two smoothed runs stands, with the compass or without it, and what its heading rests on.

A compass that is turned or offset misleads a smoother that stays sure of itself, in tilt as well. A run without it
finds heading from motion, surely where the vehicle moved by steps, turns or wind. With

    Dz = rms of (heading with - heading without) / joint sigma

======================= ============ =======================================================================
run without the compass Dz           what stands
======================= ============ =======================================================================
sure                    up to 1      the run with it: heading from ``both``; sigma = hypot(own, difference)
sure                    above 1      the run without it: ``motion``
not sure                up to 1      the run with it if that is sure: ``compass``, which nothing confirms
not sure                above 1      no heading: ``nobody``
======================= ============ =======================================================================
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from attlog.base import rotation
from attlog.estimators.base import Array, Estimate
from attlog.estimators.filters.navigation.attitude import SURE_DEG, own_sigma, refusal

HeadingFrom = Literal["both", "compass", "motion", "nobody"]
MOST_DISAGREEMENT = 1.0
"""Joint sigmas between two headings of which one shares every sensor with the other: sound compasses stay below 0.85
(24 simulated flights), turned by 15 deg they are above it on 22."""
COMPARED = 20_000
"""Samples that are compared: smoothed attitudes differ slowly, and a long run's copies are large."""
NO_NORTH = "neither GNSS nor a compass shows north"


def alone(run: Estimate) -> Estimate:
    """The run of a log without a compass: its heading is from motion where it is sure of it, else from nobody."""
    if own_deg(run) <= SURE_DEG:
        return _with_heading(run, "motion")
    return without_heading(run, "no compass, and motion does not show it")


def by_compass(run: Estimate) -> Estimate:
    """A run without GNSS: nothing confirms its compass."""
    return _with_heading(run, "compass")


def chosen(with_compass: Estimate, without: Estimate) -> Estimate:
    """The run that stands of two over the same samples, and what its heading rests on."""
    tilt, heading = differences(with_compass, without)
    disagreement = rms(heading / _joint_sigma(with_compass, without, "sigma_heading"))
    agree = disagreement <= MOST_DISAGREEMENT
    told: dict[str, float | str] = {"compass_disagreement": disagreement}
    if own_deg(without) <= SURE_DEG:
        if agree:
            return _with_heading(_widened(with_compass, rms(tilt), rms(heading)), "both", told)
        return _with_heading(without, "motion", told)
    if agree and own_deg(with_compass) <= SURE_DEG:
        return _with_heading(with_compass, "compass", told)
    differ = rms(tilt / _joint_sigma(with_compass, without, "sigma_tilt")) > MOST_DISAGREEMENT
    surer = own_deg(without, "sigma_tilt") < own_deg(with_compass, "sigma_tilt")
    why = "neither compass nor motion is sure of it"
    if not agree:
        why = f"compass and motion differ by {math.degrees(rms(heading)):.0f} deg, and motion is not sure of it"
    return without_heading(without if differ and surer else with_compass, why, told)


def without_heading(run: Estimate, why: str, told: Mapping[str, float | str] | None = None) -> Estimate:
    """The run with a heading that nobody vouches for; ``why`` completes "no heading: "."""
    unknown = np.full(len(run.t), np.pi)
    told = {**(told or {}), "heading_why": why, "sigma_heading_deg": 180.0}
    run = replace(run, aux=run.aux | {"sigma_heading": unknown})
    return _with_heading(run, "nobody", told)


def differences(a: Estimate, b: Estimate) -> tuple[Array, Array]:
    """Tilt and, with its sign, heading (k,) in rad of one run against another over the same samples, thinned."""
    e = rotation.error(_thinned(a.q), _thinned(b.q))
    return rotation.inclination_angle(e), rotation.heading_angle(e)


def rms(x: Array) -> float:
    """Root mean square; 0 of nothing."""
    return float(np.sqrt(np.mean(x * x))) if len(x) else 0.0


def own_deg(run: Estimate, name: str = "sigma_heading") -> float:
    """What a run says of its errors, RMS in deg; no number is not sure."""
    own = math.degrees(rms(run.aux[name]))
    return own if math.isfinite(own) else math.inf


def _joint_sigma(a: Estimate, b: Estimate, name: str) -> Array:
    joint: Array = np.hypot(_thinned(a.aux[name]), _thinned(b.aux[name]))
    return joint


def _thinned(x: Array) -> Array:
    return x[:: max(1, len(x) // COMPARED)]


def _widened(run: Estimate, tilt: float, heading: float) -> Estimate:
    """The run with sigmas that hold the difference (rad, RMS) to the run without the compass."""
    sigmas = {
        name: np.hypot(run.aux[name], difference)
        for name, difference in (("sigma_tilt", tilt), ("sigma_heading", heading))
    }
    return replace(run, aux=run.aux | sigmas, quality=run.quality | own_sigma(*sigmas.values()))


def _with_heading(run: Estimate, found: HeadingFrom, told: Mapping[str, float | str] | None = None) -> Estimate:
    """The run, saying what its heading rests on."""
    quality = run.quality | {"heading_from": found, **(told or {})}
    return replace(run, quality=quality | {"refused": refusal(quality)})
