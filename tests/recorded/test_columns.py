"""Times of a column that names no unit: the one that makes a rate of attitudes, the longest where two do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from attlog.recorded import columns


@pytest.mark.parametrize(("step", "unit_s"), [(0.02, 1.0), (20.0, 1e-3), (500.0, 1e-3), (5000.0, 1e-6), (2e7, 1e-9)])
def test_a_time_without_a_unit_has_the_one_that_makes_a_rate(tmp_path: Path, step: float, unit_s: float) -> None:
    path = tmp_path / "a.csv"
    t = step * np.arange(5)
    path.write_text("\n".join(["t,qw,qx,qy,qz", *(f"{x},1,0,0,0" for x in t)]) + "\n")
    assert columns.read(path).t == pytest.approx(unit_s * t)
