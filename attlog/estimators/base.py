"""What an estimator is: parameters, a start, a step, and what a run returns.

An estimator knows numbers only: no log, no vehicle, no files. Its file holds a
docstring with equations and source, ``PARAMETERS``, ``PRESETS`` and two plain
functions that numba can compile, ``start`` and ``step``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A knob: what it means, its unit, range, default, and where the default comes from.

    ``choices`` names the values of a switch; the kernel sees the position in the
    tuple as a float.
    """

    name: str
    default: float | str
    unit: str
    low: float
    high: float
    meaning: str
    source: str
    choices: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Estimator:
    """A registered estimator.

    ``needs`` is a subset of {"gyro", "acc", "mag"}: what it cannot run without;
    ``uses`` is what it takes when there. ``start(params, acc, mag, q0) -> state`` and
    ``step(state, params, dt, gyr, acc, mag)`` for stepping filters, or ``run`` for
    whole-run estimators. ``state[0:4]`` is the quaternion; ``slices`` names other
    parts of the state (``bias`` in rad/s, auxiliary outputs). ``equations`` and
    ``text`` are the module docstring for people. ``causal`` is False where it
    looks ahead.
    """

    name: str
    title: str
    text: str
    source: str
    needs: frozenset[str]
    uses: frozenset[str]
    parameters: tuple[Parameter, ...]
    presets: Mapping[str, Mapping[str, float | str]]
    state_size: int = 4
    slices: Mapping[str, slice] = field(default_factory=dict)
    start: Callable[..., Any] | None = None
    step: Callable[..., Any] | None = None
    run: Callable[..., Any] | None = None
    causal: bool = True
    origin: str = "attlog"


@dataclass(slots=True)
class Estimate:
    """What a run returns, at the input's own good samples.

    ``t`` (n,) s, ``q`` (n, 4), ``bias`` (n, 3) rad/s or None, ``aux`` named (n, k)
    arrays, ``run`` (n,) int counts restarts after gaps, ``skipped`` counts input that
    was not used by reason (``nan``, ``time_not_rising``, ``saturated``, ``zero_vector``,
    ``gap_bridged``, ``restart``), ``ns_per_update`` is the measured cost.
    """

    t: Array
    q: Array
    bias: Array | None = None
    aux: dict[str, Array] = field(default_factory=dict)
    run: NDArray[np.int64] | None = None
    skipped: dict[str, int] = field(default_factory=dict)
    ns_per_update: float = 0.0
    causal: bool = True
