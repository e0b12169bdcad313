"""Attitude filters of other packages, run as their documentation says, on the trials of ``accuracy.py``.

============================ =====================================================================================
peer                         what it takes and gives
============================ =====================================================================================
``vqf``, ``vqf_offline``     rad/s, m/s², any unit of field; FLU to ENU; ``..._restored``: with the gyro that attlog's
                             filters get, half a step put back where its readings are cut towards zero
``imufusion``                deg/s, g, µT; FLU to NWU
``ahrs``                     rad/s, m/s², nT; FLU to NWU, inverse
``qmt_madgwick, qmt_mahony`` rad/s, m/s², any unit of field; FLU to ENU
``riann``                    rad/s, m/s², rate in Hz; FLU to axes with z up; no magnetometer: tilt only
``attipy``                   rad/s, m/s² (or both times the step), heading in rad; FRD to NED
============================ =====================================================================================

Quaternions are scalar first. ``tests/test_benchmarks.py`` holds each to a motion in closed form.
``pip install --no-binary qmt '.[peers]'`` brings the packages: qmt's wheels want NumPy 1. attipy 0.0.18 asks for Python
3.12, but runs on 3.11 (``pip install --no-deps --ignore-requires-python attipy``); 0.0.7 has another filter. A peer
whose package is missing is left out.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.resources
import io
import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from importlib.metadata import version
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.truncation import truncation_of
from attlog.estimators.start import start_attitude

if TYPE_CHECKING:
    from accuracy import Trial

Array = NDArray[np.float64]
FLIP = np.array([1.0, -1.0, -1.0])
FROM_NWU = np.array([1.0, 1.0, -1.0, -1.0])
"""Signs of an attitude FLU to NWU as one FRD to NED."""
ATTIPY_YAW_VAR = 0.05**2
"""rad²: attipy has no default; its example's 0.01 rad gives 48 deg on BROAD. Of 0.01 to 0.2 rad the best one there."""

Peer = Callable[["Trial"], tuple[Array, float]]
"""Gives attitudes (FRD, NED, magnetic) at the trial's times and ns per update."""


def filled(mag: Array) -> Array:
    """The magnetometer held from sample to sample: what the peers' interfaces ask for."""
    good = np.isfinite(mag).all(axis=1)
    return mag[np.maximum.accumulate(np.where(good, np.arange(len(mag)), int(np.argmax(good))))]


def step(trial: Trial) -> float:
    """Seconds from sample to sample."""
    return float(np.median(np.diff(trial.t)))


def flu(trial: Trial) -> tuple[Array, Array, Array | None]:
    """Gyro [rad/s], accelerometer [m/s²] and magnetometer [T], forward, left, up."""
    mag = None if trial.mag is None else np.ascontiguousarray(filled(trial.mag) * FLIP)
    return np.ascontiguousarray(trial.gyr * FLIP), np.ascontiguousarray(trial.acc * FLIP), mag


def first_attitude(trial: Trial) -> Array:
    """FRD to NED, as the first specific force and field show it: for peers that are given their start."""
    return start_attitude(trial.acc[0], np.zeros(3) if trial.mag is None else filled(trial.mag)[0])


def from_enu(q: Array) -> Array:
    """Attitudes FLU to ENU as FRD to NED."""
    return rotation.multiply(rotation.multiply(rotation.ENU, q), rotation.FLU)


def peer_vqf(trial: Trial) -> tuple[Array, float]:
    """vqf with default parameters, batch."""
    from vqf import VQF

    gyr, acc, mag = flu(trial)
    peer = VQF(step(trial))
    clock = time.thread_time()
    out = peer.updateBatch(gyr, acc) if mag is None else peer.updateBatch(gyr, acc, mag)
    spent = time.thread_time() - clock
    return from_enu(out["quat6D" if mag is None else "quat9D"]), 1e9 * spent / len(gyr)


def peer_vqf_offline(trial: Trial) -> tuple[Array, float]:
    """vqf's own smoother with default parameters."""
    from vqf import offlineVQF

    gyr, acc, mag = flu(trial)
    clock = time.thread_time()
    out = offlineVQF(gyr, acc, mag, step(trial))
    spent = time.thread_time() - clock
    return from_enu(out["quat6D" if mag is None else "quat9D"]), 1e9 * spent / len(gyr)


def restored(peer: Peer) -> Peer:
    """The same peer with the gyro that attlog's filters get: causal, :mod:`attlog.core.truncation`."""

    def run(trial: Trial) -> tuple[Array, float]:
        cut = truncation_of(trial.gyr)
        if cut is None:
            return peer(trial)
        gyr = np.concatenate([trial.gyr[: cut.readings], cut.restore(trial.gyr[cut.readings :])])
        return peer(replace(trial, gyr=gyr))

    return run


def peer_imufusion(trial: Trial) -> tuple[Array, float]:
    """imufusion (Madgwick's Fusion) with default settings, sample by sample."""
    import imufusion

    gyr, acc, mag = flu(trial)
    gyr, acc, mag = np.rad2deg(gyr), acc / 9.80665, None if mag is None else mag * 1e6
    peer, q = imufusion.Ahrs(), np.empty((len(gyr), 4))
    peer.set_sample_period(step(trial))
    clock = time.thread_time()
    for k in range(len(gyr)):
        if mag is None:
            peer.update_no_magnetometer(gyr[k], acc[k])
        else:
            peer.update(gyr[k], acc[k], mag[k])
        q[k] = peer.get_quaternion()
    spent = time.thread_time() - clock
    return q * FROM_NWU, 1e9 * spent / len(gyr)


def peer_ahrs(trial: Trial) -> tuple[Array, float]:
    """ahrs.filters.Madgwick with default gain."""
    from ahrs.filters import Madgwick

    gyr, acc, mag = flu(trial)
    clock = time.thread_time()
    q = Madgwick(gyr=gyr, acc=acc, mag=None if mag is None else mag * 1e9, Dt=step(trial)).Q
    return q * FROM_NWU, 1e9 * (time.thread_time() - clock) / len(gyr)


def peer_qmt_madgwick(trial: Trial) -> tuple[Array, float]:
    """qmt's Madgwick with default gain."""
    from qmt import oriEstMadgwick

    return of_qmt(oriEstMadgwick, trial)


def peer_qmt_mahony(trial: Trial) -> tuple[Array, float]:
    """qmt's Mahony with default gains: no bias is estimated."""
    from qmt import oriEstMahony

    return of_qmt(oriEstMahony, trial)


def of_qmt(function: Callable[..., Array], trial: Trial) -> tuple[Array, float]:
    """What one of qmt's batch functions gives, started where the first vectors point.

    Their own start is the identity, from which Mahony needs minutes. ``initQuat`` is FLU to NWU, what they give to ENU.
    """
    gyr, acc, mag = flu(trial)
    settings = {"Ts": step(trial), "initQuat": first_attitude(trial) * FROM_NWU}
    clock = time.thread_time()
    q = function(gyr, acc, mag, settings)
    return from_enu(q), 1e9 * (time.thread_time() - clock) / len(gyr)


def peer_riann(trial: Trial) -> tuple[Array, float]:
    """riann's network over the whole trial; the time is that of all its threads.

    Its own search for the network's file fails on Python 3.11, so the path is given.
    """
    from riann import RIANN

    gyr, acc, _ = flu(trial)
    peer = RIANN(str(importlib.resources.files("riann") / "riann.onnx"))
    clock = time.process_time()
    q = peer.predict(acc, gyr, 1.0 / step(trial))
    return from_enu(q), 1e9 * (time.process_time() - clock) / len(gyr)


def peer_attipy(trial: Trial) -> tuple[Array, float]:
    """attipy's Kalman filter with default settings, sample by sample.

    It wants the first attitude, here that of the first vectors, and a heading, here that of each sample's field about
    the filter's own vertical.
    """
    attipy_attitudes(trial, 3)  # compiles
    clock = time.thread_time()
    q = attipy_attitudes(trial, len(trial.t))
    return q, 1e9 * (time.thread_time() - clock) / len(q)


def attipy_attitudes(trial: Trial, n: int) -> Array:
    """The first ``n`` attitudes (n, 4) FRD to NED."""
    from attipy import MEKF

    dt, q = step(trial), np.empty((n, 4))
    peer = MEKF(1.0 / dt, first_attitude(trial))
    fields = np.full(trial.acc.shape, np.nan) if trial.mag is None else trial.mag
    known = np.isfinite(fields).all(axis=1)
    attitude, turns, forces = peer.attitude.as_quaternion(), dt * trial.gyr, dt * trial.acc
    for k in range(n):
        yaw = field_heading(down(attitude, turns[k]), fields[k]) if known[k] else None
        peer.update(dv=forces[k], dtheta=turns[k], yaw=yaw, yaw_var=ATTIPY_YAW_VAR)
        q[k] = attitude = peer.attitude.as_quaternion()
    return q


def down(attitude: Sequence[float], turn: Sequence[float]) -> tuple[float, float, float]:
    """Down in the body's axes after a small further turn [rad]."""
    w, x, y, z = map(float, attitude)
    a, b, c = map(float, turn)
    d, e, f = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
    return d + e * c - f * b, e + f * a - d * c, f + d * b - e * a


def field_heading(vertical: Sequence[float], field: Sequence[float]) -> float:
    """Heading [rad] of the body's x axis against the field's horizontal part: atan2((d x m)_x, ((d x m) x d)_x)."""
    d, e, f = vertical
    x, y, z = map(float, field)
    return math.atan2(e * z - f * y, (f * x - d * z) * f - (d * y - e * x) * e)


PEERS: dict[str, Peer] = {
    "vqf": peer_vqf,
    "vqf_offline": peer_vqf_offline,
    "vqf_restored": restored(peer_vqf),
    "vqf_offline_restored": restored(peer_vqf_offline),
    "imufusion": peer_imufusion,
    "ahrs": peer_ahrs,
    "qmt_madgwick": peer_qmt_madgwick,
    "qmt_mahony": peer_qmt_mahony,
    "riann": peer_riann,
    "attipy": peer_attipy,
}
NEEDS = {
    "vqf": ("vqf", "VQF"),
    "vqf_offline": ("vqf", "offlineVQF"),
    "vqf_restored": ("vqf", "VQF"),
    "vqf_offline_restored": ("vqf", "offlineVQF"),
    "imufusion": ("imufusion", "Ahrs"),
    "ahrs": ("ahrs.filters", "Madgwick"),
    "qmt_madgwick": ("qmt.cpp.madgwick", "MadgwickAHRS"),
    "qmt_mahony": ("qmt.cpp.madgwick", "MahonyAHRS"),
    "riann": ("riann", "RIANN"),
    "attipy": ("attipy", "MEKF"),
}
"""Module and what a peer uses of it; qmt loads its compiled part late."""
WITHOUT_HEADING = frozenset({"riann"})
"""Peers that take no field: they tell the tilt only."""


def installed(names: Iterable[str]) -> list[str]:
    """Those of the peers whose package works here; for each other one line is printed that says why it is left out."""
    found = []
    for name in names:
        reason = why_not(*NEEDS[name])
        if reason:
            print(f"peer {name}: {reason}")
        else:
            found.append(name)
    return found


def why_not(module: str, used: str) -> str:
    """Why ``used`` cannot be had of a module, empty if it can."""
    package = module.partition(".")[0]
    try:
        with contextlib.redirect_stderr(io.StringIO()):  # NumPy prints a traceback about wheels for NumPy 1
            there = hasattr(importlib.import_module(module), used)
    except ModuleNotFoundError as error:
        return "not installed" if error.name in (None, package, module) else f"not installed: {error.name}"
    except ImportError as error:
        return f"cannot be loaded: {str(error).partition(' (')[0]}"
    return "" if there else f"{package} {version(package)} has no {used}"
