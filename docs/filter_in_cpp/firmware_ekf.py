"""An error-state Kalman filter in C++, as a firmware links it.

    q' = q (x) (0, w - b)/2        v' = R f + g        b' = 0
    GNSS: v      magnetometer: heading      no GNSS: v = 0 within hold_noise

firmware_ekf.cpp knows nothing of attlog; replay.cpp hands it a log's samples in the order of time.
"""

import ctypes
from pathlib import Path

import numpy as np

from attlog.core import rotation
from attlog.estimators import Estimate, Parameter, estimate

SOURCE = "firmware_ekf.cpp"
USES = {"mag", "gnss"}
STATE = {"q": 4, "bias": 3}
CODE = "firmware_ekf.hpp"
PARAMETERS = (  # in the order of replay.cpp
    Parameter("gyro_noise", 0.005, "rad/s/sqrt(Hz)", 1e-5, 1, "gyro noise: large trusts the other sensors", CODE),
    Parameter("acc_noise", 0.5, "m/s^2/sqrt(Hz)", 1e-3, 10, "accelerometer noise: large corrects tilt slowly", CODE),
    Parameter("bias_walk", 2e-4, "rad/s/sqrt(s)", 0, 0.1, "random walk of the gyro bias", CODE),
    Parameter("velocity_noise", 0.3, "m/s", 0.01, 20, "a GNSS velocity is not believed to be better", CODE),
    Parameter("hold_noise", 3.0, "m/s", 0.1, 100, "spread of velocity about zero without GNSS", CODE),
    Parameter("heading_noise", 0.15, "rad", 0.01, 3, "of a magnetometer sample", CODE),
    Parameter("gate", 5.0, "sigma", 1, 100, "larger innovations are rejected", CODE),
)
START_US = 1_000_000  # a firmware takes 0 for "never"

NUMBERS = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
TIMES = np.ctypeslib.ndpointer(np.uint64, flags="C_CONTIGUOUS")
replay = ctypes.CDLL(str(Path(__file__).with_name("firmware_ekf.so"))).replay
replay.argtypes = [NUMBERS, *[ctypes.c_long, TIMES, NUMBERS] * 3, NUMBERS]
replay.restype = None


def run(t, gyr, acc, mag, aids, params):
    dt = np.diff(t, prepend=t[:1])
    seen = np.maximum.accumulate(np.where(acc.any(axis=1), np.arange(len(t)), 0))
    force = acc[seen]  # zero rows are missing samples
    if aids.sampling == "instant":  # values at the times, not means over the intervals
        force[1:] = 0.5 * (force[1:] + force[:-1])
    imu = np.column_stack([gyr * dt[:, None], force * dt[:, None], dt])

    def clock(times):
        return np.rint(1e6 * (times - t[0]) + START_US).astype(np.uint64)

    field, gnss = aids.mag, aids.velocity
    own = [np.empty(0, np.uint64), np.empty((0, 3))] if field is None else [clock(field.t), field.x]
    fixes = [np.empty(0, np.uint64), np.empty((0, 4))]
    if gnss is not None:
        sigma = np.zeros(len(gnss.t)) if gnss.sigma is None else np.nan_to_num(gnss.sigma)
        whole = np.isfinite(gnss.x).all(axis=1)
        fixes = [clock(gnss.t[whole]), np.column_stack([gnss.x, sigma])[whole]]
    north = np.deg2rad(params["declination"])
    values = np.array([*(params[p.name] for p in PARAMETERS), north])
    out = np.empty((len(t), 10))
    parts = ((clock(t), imu), own, fixes)
    replay(values, *(x for times, rows in parts for x in (len(times), times, np.ascontiguousarray(rows))), out)

    q, aligned = rotation.normalize(out[:, :4]), out[:, 9] > 0  # a float's norm is good to 1e-7
    if aligned.any():  # before the alignment: its attitude, turned back by the gyro
        first = int(np.argmax(aligned))
        turned = estimate("gyro", t[: first + 1], gyr[: first + 1], q0=[1.0, 0.0, 0.0, 0.0]).q
        q[:first] = rotation.multiply(q[first], rotation.multiply(rotation.conjugate(turned[-1]), turned[:-1]))
    sigmas = {"sigma_tilt": out[:, 7], "sigma_heading": out[:, 8]}
    # attlog adds the declination, which the library has added.
    return Estimate(t=t, q=rotation.turn_about_down(q, -north), bias=out[:, 4:7], aux=sigmas)
