"""The one set of numbers for every vehicle and firmware, what users and calibration change of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from attlog.estimators.base import Array, Parameter
from attlog.estimators.filters.navigation.layout import (
    GRAVITY_AT,
    GROUPS,
    HARD_GATE,
    Q_ACC,
    Q_ACC_REST,
    Q_BA,
    Q_BARO,
    Q_BG,
    Q_GYRO,
    Q_HARD,
    Q_WANDER,
    SETTINGS,
    SOFT_GATE,
    WANDER_TAU,
)

MEASURED = "attlog; measured on simulated flights of both firmwares"
PRIORS = (
    Parameter("gyro_bias_sigma", 1.0, "deg/s", 0.001, 20, "spread of the gyro bias where no rest shows it", MEASURED),
    Parameter("acc_bias_sigma", 0.1, "m/s^2", 0.001, 2, "spread of the accelerometer bias", MEASURED),
    Parameter("declination_sigma", 0.6, "deg", 0.01, 20, "spread of the declination around the model's", MEASURED),
)
GATE = Parameter("soft_gate", 2.5, "", 1, 100, "innovations beyond so many sigma count less", MEASURED)
"""Parameters of ``eskf`` and ``smoother`` alike."""
NODE_S, FINE_S = 0.04, 0.02
"""Longest time between nodes, and where a smoothed attitude is told: in between its correction is that of a node."""
MAG_BLOCK_S, BARO_BLOCK_S = 0.04, 0.05
HARD_SIGMA = 30.0
WANDER_S, WANDER_M = 100.0, 1.0
JUMP_RAD_S = np.deg2rad(3.0)
"""How far the gyro bias may jump where it does, one sigma."""
REST_SPEED, REST_EVERY_S, REST_MEAN_S = 0.02, 0.2, 0.2
LEAST_R = (0.02, 0.02, 0.03, 0.03, 0.02, 0.001, 1e-6, REST_SPEED)
"""Receivers are never better: a GNSS of 4 mm/s would make timing errors look like information. m/s, m, m, G, rad/s."""
START_R = (0.1, 0.1, 0.5, 0.5, 0.3, 0.010, 1e-4, REST_SPEED)


@dataclass(frozen=True, slots=True)
class PriorSpreads:
    """Standard deviations at the start: SI units, field in gauss, angles in rad, soft iron and scale as parts of 1."""

    gyro_bias_rest: float = np.deg2rad(0.3)
    gyro_bias: float = np.deg2rad(1.0)
    acc_bias: float = 0.1
    declination: float = np.deg2rad(0.6)
    field_size: float = 0.015
    hard: float = 0.010
    soft: float = 0.006
    arm: float = 0.03
    scale: float = 0.005
    gnss_delay: float = 0.08
    mag_delay: float = 0.03
    wander: float = WANDER_M
    baro: float = 5.0


@dataclass(frozen=True, slots=True)
class NoiseLevels:
    """Noise levels, delays and prior spreads: where a run starts from and what calibration finds.

    ``r`` (8,) standard deviations of the groups of :mod:`layout`; densities ``gyro`` rad/s/sqrt(Hz), ``acc``
    m/s^2/sqrt(Hz), random walks of the biases per sqrt(s); ``gnss_delay``, ``mag_delay`` s.
    """

    r: Array = field(default_factory=lambda: np.array(START_R))
    gyro: float = 5e-4
    acc: float = 0.03
    acc_rest: float = 3e-3
    gyro_walk: float = 1e-5
    acc_walk: float = 3e-4
    hard_walk: float = 20e-6
    wander_walk: float = WANDER_M * np.sqrt(2.0 / WANDER_S)
    baro_walk: float = 0.05
    gnss_delay: float = 0.12
    mag_delay: float = 0.0
    prior: PriorSpreads = PriorSpreads()

    def packed(self, gravity: float, soft_gate: float) -> Array:
        """The numbers as the kernels take them."""
        par = np.zeros(SETTINGS)
        par[GRAVITY_AT], par[SOFT_GATE], par[HARD_GATE] = gravity, soft_gate, HARD_SIGMA
        par[Q_GYRO], par[Q_ACC], par[Q_ACC_REST] = self.gyro, self.acc, self.acc_rest
        par[Q_BG], par[Q_BA], par[Q_HARD] = self.gyro_walk, self.acc_walk, self.hard_walk
        par[Q_WANDER], par[Q_BARO], par[WANDER_TAU] = self.wander_walk, self.baro_walk, WANDER_S
        return par


def started(params: Mapping[str, float | str]) -> NoiseLevels:
    """The defaults with what a user may set by hand."""
    prior = PriorSpreads(
        gyro_bias=np.deg2rad(float(params["gyro_bias_sigma"])),
        acc_bias=float(params["acc_bias_sigma"]),
        declination=np.deg2rad(float(params["declination_sigma"])),
    )
    return replace(NoiseLevels(), prior=prior)


assert len(START_R) == len(LEAST_R) == GROUPS
