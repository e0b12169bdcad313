"""The parameters that several filters share, so that a name means the same everywhere."""

from __future__ import annotations

from attlog.estimators.base import Parameter

ACC_FORM = Parameter(
    "acc_form",
    "vector",
    "",
    0,
    1,
    "gravity error from the direction f/|f| of the specific force, or the vector f/g, in which accelerations cancel",
    "attlog; vectors average to gravity, directions do not: BROAD inclination 4.2 -> 2.5 deg (mahony, kp 0.6)",
    ("direction", "vector"),
)
MAG_FORM = Parameter(
    "mag_form",
    "heading",
    "",
    0,
    1,
    "what the magnetometer corrects: heading only, or all axes by the cross product with the whole field vector",
    "attlog; heading keeps a disturbed field out of roll and pitch",
    ("heading", "vector"),
)
INTEGRATOR = Parameter(
    "integrator",
    "exact",
    "",
    0,
    1,
    "attitude step: exponential map, or the papers' first-order Runge-Kutta with renormalisation",
    "attlog; first_order is Lyu 8-10, Fan 3, Xu 6-10",
    ("exact", "first_order"),
)
KI_PER = Parameter(
    "ki_per",
    "second",
    "",
    0,
    1,
    "whether the integral adds error * dt or, as many microcontroller codes do, the plain error of each sample",
    "attlog; the papers do not say it",
    ("second", "sample"),
)
MAG_GAIN = Parameter(
    "mag_gain",
    1.0,
    "1",
    0,
    10,
    "weight of the magnetometer error; 1 as in the papers, 0 leaves heading to the gyro",
    "attlog, equal weights",
)
AS_PRINTED = {"acc_form": "direction", "integrator": "first_order"}
"""What the papers' presets share: unit vectors and the first-order step."""
