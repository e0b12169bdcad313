"""Which of two smoothed runs stands, with the compass or without it, and what its heading rests on.

A compass that is turned or offset misleads a smoother that stays sure of itself, in tilt as well. A run without it
finds heading from motion, surely where the vehicle moved by steps, turns or wind. With

    Dz = rms of (heading with - heading without) / joint sigma

======================= ============ =======================================================================
run without the compass Dz           what stands
======================= ============ =======================================================================
sure                    up to 1      the run with it: heading from ``both``
sure                    above 1      the run without it: ``motion``
not sure                up to 1      the run with it if that is sure: ``compass``, which nothing confirms
not sure                above 1      the run with it, without its heading: ``nobody``
======================= ============ =======================================================================

Sigmas hold the difference of the runs, sigma = hypot(own, difference): of the heading where both are sure of it and Dz
is up to 2, of the tilt unless the compass is beyond doubt the one that errs.
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
OWN_HEADING = "own_sigma_heading"
"""What a run by motion alone says of its heading (rad) where that is too unsure for a reference; pi if contradicted."""
NO_NORTH = "neither GNSS nor a compass shows north"
OPEN = 2.0
"""Up to so many joint sigmas it is open which of the runs errs, and the difference is part of the sigma: a wrong gyro
scale or accelerometer bias parts the runs by less (chosen on 24 flights with 18 faults)."""


def alone(run: Estimate) -> Estimate:
    """The run of a log without a compass: its heading is from motion where it is sure of it, else from nobody."""
    if own_deg(run) <= SURE_DEG:
        return _with_heading(run, "motion")
    unsure = without_heading(run, "no compass, and motion does not show it")
    return replace(unsure, aux=unsure.aux | {OWN_HEADING: run.aux["sigma_heading"]})


def by_compass(run: Estimate) -> Estimate:
    """A run without GNSS: nothing confirms its compass."""
    return _with_heading(run, "compass")


def chosen(with_compass: Estimate, without: Estimate) -> Estimate:
    """The run that stands of two over the same samples, and what its heading rests on."""
    differ = differences(with_compass, without)
    disagreement = rms(differ[1] / _joint_sigma(with_compass, without, "sigma_heading"))
    tilt, heading = (rms(x) for x in differ)
    agree = disagreement <= MOST_DISAGREEMENT
    told: dict[str, float | str] = {"compass_disagreement": disagreement}
    if own_deg(without) <= SURE_DEG:
        stands = with_compass if agree else without
        stands = _widened(stands, tilt, heading) if disagreement <= OPEN else stands
        return _with_heading(stands, "both" if agree else "motion", told)
    stands = _widened(with_compass, tilt, 0.0)
    if agree and own_deg(with_compass) <= SURE_DEG:
        return _with_heading(stands, "compass", told)
    why = "neither compass nor motion is sure of it"
    if not agree:
        why = f"compass and motion differ by {math.degrees(heading):.0f} deg, and motion is not sure of it"
    return without_heading(stands, why, told)


def without_heading(run: Estimate, why: str, told: Mapping[str, float | str] | None = None) -> Estimate:
    """The run with a heading that nobody vouches for; ``why`` completes "no heading: "."""
    unknown = np.full(len(run.t), np.pi)
    told = {**(told or {}), "heading_why": why, "sigma_heading_deg": 180.0}
    run = replace(run, aux=run.aux | {"sigma_heading": unknown, OWN_HEADING: unknown})
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
