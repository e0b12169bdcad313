"""At which offset, which sigma and which change of bias a heading is withheld: each limit from both sides."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.estimators import Estimate
from attlog.estimators.filters import heading_checks, pair

N = 10


def run(sigma_deg: float = 0.5, **quality: float | str) -> Estimate:
    sigmas = {"sigma_tilt": np.full(N, 1e-3), "sigma_heading": np.radians(np.full(N, sigma_deg))}
    told: dict[str, float | str] = {"heading_from": "both", "sigma_tilt_deg": 0.1, "sigma_heading_deg": sigma_deg}
    return Estimate(np.arange(N) * 0.1, np.tile([1.0, 0, 0, 0], (N, 1)), aux=sigmas, quality=told | quality)


def checked(monkeypatch: pytest.MonkeyPatch, one: Estimate, offset: Any = None, changed: float = 0.0) -> Estimate:
    monkeypatch.setattr(heading_checks, "by_gnss", lambda run, inputs: offset)
    monkeypatch.setattr(heading_checks, "bias_change_dps", lambda inputs: changed)
    none: Any = None
    return heading_checks.checked(one, none)


def gnss(offset: float, sigma: float = 0.1, told: bool = True) -> Any:
    return SimpleNamespace(offset_deg=offset, sigma_deg=sigma, told=told)


@pytest.mark.parametrize(
    ("offset", "sigma", "own", "stands"),
    [
        (2.9, 0.1, 0.1, True),
        (3.1, 0.1, 0.1, False),
        (-3.1, 0.1, 0.1, False),
        (14.9, 3.0, 4.0, True),
        (15.1, 3.0, 4.0, False),
        (-15.1, 3.0, 4.0, False),
    ],
)
def test_a_heading_stands_within_three_degrees_and_three_joint_sigmas_of_gnss(
    monkeypatch: pytest.MonkeyPatch, offset: float, sigma: float, own: float, stands: bool
) -> None:
    found = checked(monkeypatch, run(own), gnss(offset, sigma))
    assert (found.quality["heading_from"] == "both") == stands
    assert (found.quality["heading_gnss_deg"], found.quality["heading_gnss_sigma_deg"]) == (offset, sigma)
    if not stands:
        assert f"shows it {abs(offset):.0f} deg off" in str(found.quality["heading_why"])


def test_what_gnss_does_not_tell_is_no_contradiction(monkeypatch: pytest.MonkeyPatch) -> None:
    for offset in (None, gnss(90.0, told=False)):
        found = checked(monkeypatch, run(), offset)
        assert found.quality["heading_from"] == "both"
        assert "heading_gnss_deg" not in found.quality


@pytest.mark.parametrize(("changed", "stands"), [(0.49, True), (0.51, False)])
def test_a_bias_that_changed_by_half_a_degree_per_second_leaves_no_heading(
    monkeypatch: pytest.MonkeyPatch, changed: float, stands: bool
) -> None:
    assert (checked(monkeypatch, run(), changed=changed).quality["heading_from"] == "both") == stands
    assert checked(monkeypatch, run(gyro_jump_s=5.0), changed=9.0).quality["heading_from"] == "both"


@pytest.mark.parametrize(("own", "asked"), [(4.9, True), (5.1, False)])
def test_a_heading_from_nobody_is_checked_up_to_five_degrees(
    monkeypatch: pytest.MonkeyPatch, own: float, asked: bool
) -> None:
    unsure = run(own, heading_from="nobody", heading_why="so")
    assert ("heading_gnss_deg" in checked(monkeypatch, unsure, gnss(1.0)).quality) == asked
    unsure = run(0.1, heading_from="nobody", heading_why="so")
    unsure.aux[pair.OWN_HEADING] = np.radians(np.full(N, own))
    assert ("heading_gnss_deg" in checked(monkeypatch, unsure, gnss(1.0)).quality) == asked


@pytest.mark.parametrize(("sigma", "found"), [(0.99, "motion"), (1.01, "nobody"), (np.nan, "nobody")])
def test_without_a_compass_a_heading_stands_that_is_sure_to_a_degree(sigma: float, found: str) -> None:
    alone = pair.alone(run(sigma))
    assert alone.quality["heading_from"] == found
    assert (pair.OWN_HEADING in alone.aux) == (found == "nobody")
    assert pair.by_compass(run(sigma)).quality["heading_from"] == "compass"


def test_rms_of_nothing_is_nothing_and_long_runs_are_thinned(monkeypatch: pytest.MonkeyPatch) -> None:
    assert pair.rms(np.zeros(0)) == 0.0
    assert pair.rms(np.array([3.0, -4.0])) == pytest.approx(np.sqrt(12.5))
    assert pair.own_deg(run(np.inf)) == np.inf
    monkeypatch.setattr(pair, "COMPARED", 4)
    assert pair._thinned(np.arange(9)).tolist() == [0, 2, 4, 6, 8]
    assert pair._thinned(np.arange(3)).tolist() == [0, 1, 2]
