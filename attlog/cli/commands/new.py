"""``attlog new``: a filter of one's own, as a file to fill in."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import Annotated

import typer

TEMPLATE = '''"""My filter: one line that says what it is.

Equations, for people:

    e   = v x d                     v = -f/g measured down, d predicted down (body axes)
    q'  = q (x) (0, w - b + kp e)/2, b' = -ki e

Frames: body is forward-right-down, earth north-east-down. q turns body vectors into
earth vectors, scalar first. gyr [rad/s], acc [m/s^2] is specific force (at rest
(0, 0, -9.8) when level), mag in any unit.

The loop around it owns time: it skips and counts NaN, gaps, saturation and times that do
not rise, propagates slow magnetometer samples between updates, and starts at q0. A zero
vector in acc or mag means "no sample now". acc and mag belong to the time of the attitude that
step is given; a filter that turns it first and compares then says VECTORS_AT = "end".

USES may also name gnss, baro, airspeed and at_rest: step then takes one argument more, aid
(attlog.estimators.aids says what is in it).
"""

import numpy as np

from attlog.estimators import Parameter
from attlog.estimators.vectors import field_error, gravity_error, turn

SOURCE = "where the equations come from"
NEEDS = {"gyro", "acc"}  # cannot run without
USES = {"mag"}  # takes it when there

# Sizes by name, in the order of the state array. "bias" [rad/s] is shown and used between
# magnetometer samples; any other name becomes an output, one that begins with _ does not.
STATE = {"q": 4, "bias": 3}

PARAMETERS = (
    # name, default, unit, lowest, highest, meaning, where the default comes from
    Parameter("kp", 0.6, "1/s", 0, 100, "gain of the error; 1/kp is the time constant", "my choice"),
    Parameter("ki", 0.002, "1/s^2", 0, 10, "gain of the gyro bias estimate", "my choice"),
)
PRESETS = {"gentle": {"kp": 0.2}, "eager": {"kp": 2.0}}

# Optional: values that follow from the log's own parameters (by name) and facts
# (attlog.estimators.LogInfo); a preset and what is asked for by name win.
# def from_log(params, info):
#     return {"kp": params["AHRS_RP_P"]} if "AHRS_RP_P" in params else {}


def start(params, acc, mag, q0):
    """The first state; q0 is the attitude that accelerometer and magnetometer show at the start."""
    state = np.zeros(7)
    state[0:4] = q0
    return state


def step(state, params, dt, gyr, acc, mag):
    """One update, in place: params in the order of PARAMETERS, dt [s] > 0.

    Plain numbers, elements of arrays, math and small functions of this file compile to
    machine code; the helpers in attlog.estimators.vectors do the usual vector maths.
    What numba cannot compile (a C library through ctypes) runs in plain Python, and that is said.
    """
    kp, ki = params[0], params[1]
    gx, gy, gz = gravity_error(state, acc, 1.0)  # 0.0: direction of f only
    mx, my, mz = field_error(state, mag, 0.0)  # 1.0: the whole field vector
    ex, ey, ez = gx + mx, gy + my, gz + mz
    state[4] -= ki * ex * dt
    state[5] -= ki * ey * dt
    state[6] -= ki * ez * dt
    turn(state, gyr[0] - state[4] + kp * ex, gyr[1] - state[5] + kp * ey, gyr[2] - state[6] + kp * ez, dt, 0.0)
'''

RUN_TEMPLATE = '''"""My filter: one line that says what it is.

This one takes whole segments: for packages and C libraries with a loop of their own, and for
smoothers. What follows is a small filter in plain Python; put your call in its place.

Frames: body is forward-right-down, earth north-east-down. q turns body vectors into
earth vectors, scalar first. gyr [rad/s], acc [m/s^2] is specific force (at rest
(0, 0, -9.8) when level), mag in any unit.
"""

import numpy as np

from attlog.estimators import Estimate, Parameter, propagated
from attlog.estimators.start import start_attitude
from attlog.estimators.vectors import field_error, gravity_error, turn

SOURCE = "where the equations come from"
NEEDS = {"gyro", "acc"}  # cannot run without
USES = {"mag"}  # takes it when there; gnss, baro, airspeed, at_rest come in aids
CAUSAL = True  # False for a smoother: the report then says that it looks ahead
PARAMETERS = (
    # name, default, unit, lowest, highest, meaning, where the default comes from
    Parameter("kp", 0.6, "1/s", 0, 100, "gain of the error; 1/kp is the time constant", "my choice"),
)
PRESETS = {"gentle": {"kp": 0.2}, "eager": {"kp": 2.0}}


def run(t, gyr, acc, mag, aids, params):
    """The attitude at every time of one segment: rising times without long gaps.

    t (n,) s; gyr, acc, mag (n, 3), gyr the mean rate since the sample before; acc zero where
    there is none, mag NaN where no new sample came. aids is attlog.estimators.Aids of this
    segment, None where there is nothing; aids.mag has the magnetometer at its own times.
    params maps names to values.
    """
    field = propagated(t, gyr, mag)  # what a slow magnetometer would show now
    kp = params["kp"]
    q = np.empty((len(t), 4))
    state = start_attitude(acc[0], field[0])
    for k in range(len(t)):
        if k:
            gx, gy, gz = gravity_error(state, acc[k - 1], 1.0)  # state is still the attitude of k - 1
            mx, my, mz = field_error(state, field[k - 1], 0.0)
            w = gyr[k] + kp * np.array([gx + mx, gy + my, gz + mz])
            turn(state, w[0], w[1], w[2], t[k] - t[k - 1], 0.0)
        q[k] = state
    return Estimate(t=t, q=q)  # bias=(n, 3) rad/s and aux={"name": (n, k)} may be added
'''


def command(
    file: Annotated[Path, typer.Argument(metavar="FILE.py", help="Write this file, which must not exist.")],
    run: Annotated[
        bool, typer.Option("--run", help="Write one that takes whole segments: for packages, C libraries, smoothers.")
    ] = False,
) -> None:
    """Write a filter of your own to start from.

    The file is commented and passes the checks as it is.

    Example: attlog new my_filter.py
    """
    from attlog.cli.printing import to_stdout
    from attlog.core.errors import OutputError, UsageError
    from attlog.core.files import write_atomic

    if file.suffix != ".py":
        raise UsageError(f"{file}: a filter is a Python file; give it the suffix .py")
    if os.path.exists(file):
        raise OutputError(f"{file}: exists already and is not overwritten; choose another name")
    write_atomic(file, RUN_TEMPLATE if run else TEMPLATE)
    typed = f"./{file}" if str(file).startswith("-") else str(file)
    to_stdout(f"{file} written. Check it: attlog check-estimator {shlex.quote(typed)}")
    to_stdout(f"Run it beside the others: attlog analyze LOG --estimators {shlex.quote(f'default,{typed}')}")
