"""The parameters that several filters share, so that a name means the same everywhere."""

from __future__ import annotations

from attlog.estimators.base import Parameter

ACC_FORM = Parameter(
    "acc_form",
    "direction",
    "",
    0,
    1,
    "gravity error from the direction of the specific force f/|f|, or from the vector f/g, in which short accelerations cancel",
    "attlog; vectors average to gravity, directions do not",
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
