"""Whether a flight is one: numbers that run away are refused instead of being written into a log."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from attlog.base.errors import UsageError
from attlog.simulate.flight import ImuStream, Truth

FARTHEST_M = 50_000.0
"""Beyond it the flat earth and the standard atmosphere of the simulator end."""
GREATEST = 1e9
"""Rates [rad/s] and specific forces [m/s^2] of no sensor on earth; single precision still holds them."""


def check_truth(truth: Truth) -> None:
    """UsageError where the motion is not finite or leaves the simulated world, with the time at which it does."""
    rows = np.hstack([truth.q, truth.w, truth.p, truth.v, truth.a])
    gone = ~np.isfinite(rows).all(axis=1) | (np.abs(truth.p) > FARTHEST_M).any(axis=1)
    if gone.any():
        raise UsageError(
            f"the motion cannot be computed from {truth.t[np.argmax(gone)]:.3g} s on: the vehicle leaves "
            f"{FARTHEST_M / 1000:g} km or every bound; look at vehicle, controller, wind and motion"
        )


def check_samples(streams: Sequence[tuple[str, ImuStream]]) -> None:
    """UsageError for an inertial unit whose samples are no numbers that a log can hold, or that has none at all."""
    for name, stream in streams:
        if not len(stream.t):
            raise UsageError(f"sensors.{name} gives no sample in this flight; look at its rate, loss and gaps")
        for part, values in (("gyro", stream.gyro), ("acc", stream.acc)):
            if not (np.abs(values) < GREATEST).all():
                raise UsageError(f"sensors.{name}.{part} gives no finite numbers; look at its noise, step and scale")
