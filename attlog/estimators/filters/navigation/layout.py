"""Where things stand in the arrays of the navigation filter.

Error state, 39 numbers: attitude (a rotation vector in earth axes, ``q_true = exp(phi) q``), velocity, position,
gyro bias, accelerometer bias, earth field, hard iron, soft iron (xx yy zz xy xz yz), wandering position error,
barometer bias, GNSS delay, magnetometer delay, lever arm of the antenna, gyro scale. The nominal state ``x`` has
the same places; its first three are unused, the attitude is the quaternion beside it.
"""

from __future__ import annotations

N = 39
PHI, V, POS, BG, BA, EARTH, HARD, SOFT, WANDER = 0, 3, 6, 9, 12, 15, 18, 21, 27
BARO_BIAS, GNSS_DELAY, MAG_DELAY, ARM, SCALE = 30, 31, 32, 33, 36

VELOCITY, POSITION, BARO, MAG, STILL, NO_RATE = 0, 1, 2, 3, 4, 5
"""Kinds of events: GNSS velocity and position, height, field, rest as zero velocity and as zero rate."""
KINDS = 6

GROUPS = 8
"""Groups of scalar updates that share a noise level: velocity level, vertical, position level, vertical, height, field,
zero rate, zero velocity."""

GRAVITY_AT, Q_GYRO, Q_ACC, Q_BG, Q_BA, Q_HARD, Q_WANDER, Q_BARO, WANDER_TAU, Q_ACC_REST, SOFT_GATE, HARD_GATE = range(
    12
)
SETTINGS = 12
"""Places of the numbers that a run of the filter is given."""

SKIPS, MAG_MEAN, SINCE_KICK, RESTING, FROZEN, OPENED, KICKED, SOFTENED, SEEN, LIKELIHOOD = (
    0,
    6,
    7,
    8,
    9,
    13,
    14,
    15,
    16,
    17,
)
MEMORY = 18
"""What the filter remembers beside its state: counters of its gates, attitude kept during rest, likelihood."""

SUM_T, SUM_A, SUM_D, SUM_W = 0, 1, 4, 13
SUMS = 22
"""Sums over the samples between two nodes: time, R f dt (3), R dt (9), R diag(w) dt (9)."""

ROW = 40
"""Numbers from one row of a covariance to the next: rows end with a zero and fill whole vector registers."""

WIDE = 12
"""Most entries of a measurement's row that are not zero."""
