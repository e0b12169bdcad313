"""A complementary filter in C, whole segments."""

import ctypes
from pathlib import Path

import numpy as np

from attlog.estimators import Estimate, Parameter, propagated
from attlog.estimators.start import start_attitude

SOURCE = "complementary.c"
USES = {"mag"}
PARAMETERS = (Parameter("kp", 0.6, "1/s", 0, 100, "gain of the error", "Xu"),)

ARRAY = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
update_all = ctypes.CDLL(str(Path(__file__).with_name("complementary.so"))).update_all
update_all.argtypes, update_all.restype = [ARRAY, ctypes.c_double, ctypes.c_int, ARRAY, ARRAY, ARRAY, ARRAY], None


def run(t, gyr, acc, mag, aids, params):
    field = propagated(t, gyr, mag)
    q = np.empty((len(t), 4))
    q[0] = start_attitude(acc[0], field[0])
    update_all(q, params["kp"], len(t), t, gyr, acc, field)
    return Estimate(t=t, q=q)
