"""Trajectories as people bring them: the truth of a flight in other axes, on another clock, noisy, in a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from attlog.core import rotation
from tests.reference.flights import attitude_at

OFFSET = -1.4e9 - 12.34
"""Unix times to the log's."""
BODY = rotation.from_euler(0.3, -1.0, 2.0)
WORLD = rotation.from_euler(2.5, 0.2, 0.3)
SAME = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass
class Made:
    """Attitudes as they stand in a file, and its times."""

    t: np.ndarray
    q: np.ndarray
    p: np.ndarray


def made(
    seed: int = 0,
    rate: float = 50.0,
    noise_deg: float = 0.1,
    drift_ppm: float = 0.0,
    body=BODY,
    world=WORLD,
    begin: float = 5.0,
    end: float = 110.0,
    offset: float = OFFSET,
) -> Made:
    """The attitude of ``tests.reference.flights`` with what a laboratory does to it."""
    rng = np.random.default_rng(seed)
    on_log = np.arange(begin, end, 1 / rate) + 0.0013
    q = attitude_at(on_log)
    q = rotation.multiply(q, rotation.from_rotvec(np.radians(noise_deg) * rng.normal(size=(len(q), 3))))
    q = rotation.multiply(world, rotation.multiply(q, body))
    t = on_log - offset
    middle = t.mean()
    return Made(middle + (t - middle) / (1.0 + 1e-6 * drift_ppm), q, np.zeros((len(q), 3)))


def tum(folder: Path, m: Made, name: str = "mocap.txt", head: str = "# t x y z qx qy qz qw") -> Path:
    rows = [" ".join(f"{x:.9f}" for x in row) for row in np.column_stack([m.t, m.p, m.q[:, 1:], m.q[:, 0]])]
    path = folder / name
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


def euroc(folder: Path, m: Made) -> Path:
    head = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"
    numbers = np.column_stack([m.p, m.q])
    rows = [",".join([f"{round(t * 1e9)}", *(f"{x:.9f}" for x in row)]) for t, row in zip(m.t, numbers, strict=True)]
    path = folder / "data.csv"
    path.write_text("\n".join([head, *rows]) + "\n")
    return path
