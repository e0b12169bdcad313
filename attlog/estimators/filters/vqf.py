"""VQF, by its authors' own package: acceleration low-passed in an almost-inertial frame.

    f_I  = low-pass(R_I f, tau_acc)        tilt from its direction
    heading from the magnetometer with gain 1 - exp(-dt / tau_mag), held back while norm or dip are disturbed
    gyro bias by a Kalman filter from tilt and rest

Source: Laidig2023, package ``vqf``.

This is an adapter. Frames are converted (the package wants z up and east-north-up);
data whose spacing varies by more than 5 % are resampled by their integrals, because
the package knows one constant rate. Without magnetometer heading starts at 0; a field within the first 3 s gives
the heading from the first sample on, a later one from then on. Samples at which the
bias is at ``bias_clip``, so that the sensor's own is probably larger, are counted as
``bias_beyond_clip``. A start in motion gave the package a bias that turned the heading by 32 deg for a minute;
with ``settle`` it is 1 deg. Preset ``package`` has the package's own values: four EuRoC flights with 4.5 deg/s
have a tilt of 5.1 deg with them, 1.5 deg with the defaults here.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from attlog.core import rotation
from attlog.estimators.interface import Array, Estimate, Parameter
from attlog.estimators.samples import UniformSamples, typical_scale, uniform
from attlog.estimators.start import MOTION_S

SOURCE = "Laidig2023; package vqf"
NEEDS = {"gyro", "acc"}
USES = {"mag"}
STATE = {"q": 4, "bias": 3, "bias_sigma": 1}
DEFAULTS = "package vqf 2.1"
# A calibrated gyro keeps heading longer than the package's 9 s. Data sheets of small gyros say 1 to 5 deg/s of bias,
# raw sensors have up to 6. While tilt is still found in motion its error passes for bias.
PARAMETERS = (
    Parameter("tau_acc", 3.0, "s", 0.01, 1000, "time constant of the accelerometer: large follows the gyro", DEFAULTS),
    Parameter(
        "tau_mag", 18.0, "s", 0.01, 1000, "time constant of the magnetometer for heading", f"attlog; 9 ({DEFAULTS})"
    ),
    Parameter(
        "bias_sigma", 1.0, "deg/s", 0.001, 100, "sigma of the gyro bias at the start", f"attlog; 0.5 ({DEFAULTS})"
    ),
    Parameter("bias_clip", 10.0, "deg/s", 0.01, 100, "largest gyro bias it will estimate", f"attlog; 2 ({DEFAULTS})"),
    Parameter(
        "settle", 10.0, "s", 0, 1000, "so long after the start the bias is found from rest only", "attlog; 0 (package)"
    ),
)
PRESETS = {"package": {"tau_acc": 3.0, "tau_mag": 9.0, "bias_sigma": 0.5, "bias_clip": 2.0, "settle": 0.0}}

FRD = np.array([1.0, -1.0, -1.0])
TO_NED = np.array([0.0, 0.5**0.5, 0.5**0.5, 0.0])
TO_FRD = np.array([0.0, 1.0, 0.0, 0.0])
# Samples handed to the package at once.
BLOCK = 1 << 14


def run(t: Array, gyr: Array, acc: Array, mag: Array, aids: Any, params: Mapping[str, float | str]) -> Estimate:
    """Return the attitude at ``t`` (n,) of one segment without gaps; ``mag`` has NaN rows where there is no sample."""
    from vqf import VQF

    u = uniform(t, gyr, acc, mag)
    del gyr, acc, mag  # a long log's are large
    has_mag = bool(u.mag.any())
    settings = {
        "tauAcc": float(params["tau_acc"]),
        "tauMag": float(params["tau_mag"]),
        "biasSigmaInit": float(params["bias_sigma"]),
        "biasClip": float(params["bias_clip"]),
    }
    filter_ = VQF(u.period, u.period, u.mag_period, **settings)
    begun = 0 if not has_mag else 1 + int(np.argmax(u.mag.any(axis=1)))
    out = updated(filter_, u, has_mag, round(float(params["settle"]) / u.period), begun)
    nothing = np.empty((0, 3))
    u = u._replace(gyr=nothing, acc=nothing, mag=nothing)
    q = out.q
    if not has_mag:
        q = rotation.turn_about_down(q, -rotation.to_euler(q[0])[2])
    else:
        heading_from_start(u.t, q, out.inertial)
    rows = slice(None) if u.regular else np.clip(np.searchsorted(u.t, t), 0, len(u.t) - 1)
    sigma = out.sigma[rows][:, None]
    bias = out.bias[rows]
    clipped = int(np.count_nonzero(np.abs(bias).max(axis=1) >= np.deg2rad(0.999 * float(params["bias_clip"]))))
    return Estimate(
        t=t,
        q=u.back(t, q),
        bias=bias,
        aux={"bias_sigma": sigma},
        skipped={"bias_beyond_clip": clipped} if clipped else {},
        ns_per_update=1e9 * out.seconds / len(t),
    )


def heading_from_start(t: Array, q: Array, inertial: Array) -> None:
    """Turn, in place, the attitudes before the first field by the heading that it shows, if it belongs to the start.

    Before a later one heading starts at 0. ``q`` (n, 4) with magnetometer; ``inertial`` (k, 4) without, up to that
    field.
    """
    field = len(inertial) - 1
    if t[field] - t[0] > MOTION_S:
        q[:field] = rotation.turn_about_down(q[:field], -rotation.to_euler(q[0])[2])
    else:
        q[:field] = rotation.turn_about_down(
            q[:field], rotation.heading_angle(rotation.earth_error(q[field], inertial[field]))
        )


@dataclass(slots=True)
class VqfOutput:
    """The package's output: ``q`` (m, 4), ``bias`` (m, 3), ``sigma`` (m,), in our axes.

    ``inertial``: the first attitudes without magnetometer; ``seconds``: CPU time of the package.
    """

    q: Array
    bias: Array
    sigma: Array
    inertial: Array
    seconds: float = 0.0


def updated(filter_: Any, u: UniformSamples, has_mag: bool, settle: int, begun: int) -> VqfOutput:
    """Run the package over all samples; in the first ``settle`` it learns no bias from motion.

    In blocks: it returns 60 numbers a sample, of which eight are kept. ``begun``: how many attitudes without
    magnetometer are wanted.
    """
    m, name, scale = len(u.t), "quat9D" if has_mag else "quat6D", typical_scale(u.mag)
    found = VqfOutput(np.empty((m, 4)), np.empty((m, 3)), np.empty(m), np.empty((begun, 4)))
    edges = sorted({min(max(settle, 0), m), *range(0, m, BLOCK), m})
    for a, b in pairwise([0, *(edge for edge in edges if edge > 0)]):
        own = slice(a, b)
        sensed = [u.gyr[own], u.acc[own], *([u.mag[own] * scale] if has_mag else [])]
        flipped = [np.ascontiguousarray(x * FRD) for x in sensed]
        filter_.setMotionBiasEstEnabled(a >= settle)
        clock = time.thread_time()
        out = filter_.updateBatch(*flipped)
        found.seconds += time.thread_time() - clock
        found.q[own] = rotation.multiply(rotation.multiply(TO_NED, out[name]), TO_FRD)
        found.bias[own], found.sigma[own] = out["bias"] * FRD, out["biasSigma"]
        if a < begun:
            inertial = out["quat6D"][: begun - a]
            found.inertial[a : a + len(inertial)] = rotation.multiply(rotation.multiply(TO_NED, inertial), TO_FRD)
    return found
