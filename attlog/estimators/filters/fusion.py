"""Fusion, by its author's own package: Madgwick's revised complementary filter with rejection.

    e    = v x d + heading error        each left out while it is larger than its rejection angle
    q'   = q (x) (0, w + gain e)/2

Source: Madgwick2014, chapter 7, package ``imufusion``.

This is an adapter: NED convention, deg/s and g, each sample with its own period, with the vectors of the sample
before, whose time is that of the attitude they are compared with. It starts like every other filter, from
averaged vectors, and not from level with the package's gain of 10 that fades in 3 s; a field that
comes later than the start sets the heading when it comes. Rejection is
off by default, as in the package: an uncorrected gyro bias b leaves an error of b / gain, and where
that is near the rejection angle (4.5 deg/s with preset ``example``: 9 of 10 deg) the accelerometer
is left out for good parts of the flight (four EuRoC flights: tilt 18 to 22 deg for 7 to 9).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from attlog.core import rotation
from attlog.core.sorting import median
from attlog.estimators.api import propagated
from attlog.estimators.interface import Array, Estimate, Parameter
from attlog.estimators.samples import typical_size
from attlog.estimators.start import first_seconds, start_attitude, turned_to_field
from attlog.estimators.vectors import GRAVITY

SOURCE = "Madgwick2014 chapter 7; package imufusion"
NEEDS = {"gyro", "acc"}
USES = {"mag"}
STATE = {"q": 4}
DEFAULTS = "package imufusion, its default settings"
EXAMPLE = "package imufusion, advanced example"
PARAMETERS = (
    Parameter("gain", 0.5, "1/s", 0, 10, "gain of the error: large follows the accelerometer", DEFAULTS),
    Parameter("acc_rejection", 0.0, "deg", 0, 90, "accelerometer left out beyond this error; 0 never", DEFAULTS),
    Parameter("mag_rejection", 0.0, "deg", 0, 90, "magnetometer left out beyond this error; 0 never", DEFAULTS),
    Parameter("timeout", 5.0, "s", 0, 1000, "how long a sensor may stay left out", EXAMPLE),
)
PRESETS: dict[str, dict[str, float | str]] = {"example": {"acc_rejection": 10.0, "mag_rejection": 10.0}}


def run(t: Array, gyr: Array, acc: Array, mag: Array, aids: Any, params: Mapping[str, float | str]) -> Estimate:
    """Return the attitude at ``t`` (n,) of one segment without gaps; ``mag`` has NaN rows where there is no sample."""
    import imufusion

    step = np.diff(t)
    period = float(median(step)) if len(step) else 0.01
    settings = imufusion.AhrsSettings()
    settings.convention = imufusion.CONVENTION_NED
    settings.sample_rate = 1.0 / period
    settings.gain = float(params["gain"])
    settings.gyroscope_range = 0.0
    settings.acceleration_rejection = float(params["acc_rejection"])
    settings.magnetic_rejection = float(params["mag_rejection"])
    settings.rejection_timeout = float(params["timeout"])
    ahrs = imufusion.Ahrs()
    ahrs.set_settings(settings)
    rate, force = np.degrees(gyr), acc / GRAVITY
    field = typical_size(propagated(t, gyr, mag))
    has_mag = bool(field.any())
    seen = first_seconds(t, gyr, acc, mag)
    ahrs.set_quaternion(start_attitude(seen.acc, seen.mag))
    ahrs.skip_startup()
    q = np.empty((len(t), 4))
    q[:1] = ahrs.get_quaternion()
    for k in range(1, len(t)):
        ahrs.set_sample_period(step[k - 1])
        if has_mag:
            # The package takes a zero vector for "no sample now".
            ahrs.update(rate[k], force[k - 1], field[k - 1])
        else:
            ahrs.update_no_magnetometer(rate[k], force[k - 1])
        if k == seen.late:
            ahrs.set_quaternion(turned_to_field(np.asarray(ahrs.get_quaternion(), np.float64), mag[k]))
        q[k] = ahrs.get_quaternion()
    q = rotation.normalize(q)
    if not has_mag:
        q = rotation.turn_about_down(q, -rotation.to_euler(q[0])[2])
    return Estimate(t=t, q=q)
