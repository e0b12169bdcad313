"""A complementary filter in C, step by step."""

import ctypes
from pathlib import Path

from attlog.estimators import Parameter

SOURCE = "complementary.c"
USES = {"mag"}
PARAMETERS = (Parameter("kp", 0.6, "1/s", 0, 100, "gain of the error", "Xu"),)

POINTER, NUMBER = ctypes.c_void_p, ctypes.c_double
update = ctypes.CDLL(str(Path(__file__).with_name("complementary.so"))).update
update.argtypes, update.restype = [POINTER, NUMBER, NUMBER, POINTER, POINTER, POINTER], None


def start(params, acc, mag, q0):
    return q0


def step(state, params, dt, gyr, acc, mag):
    update(state.ctypes.data, params[0], dt, gyr.ctypes.data, acc.ctypes.data, mag.ctypes.data)
