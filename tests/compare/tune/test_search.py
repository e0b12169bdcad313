"""The search finds minima that are known, repeats itself, and refuses ranges that are none."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from attlog.base.errors import UsageError
from attlog.compare.configurations.firmware_names import firmware_names
from attlog.compare.sweep.grid import Setting
from attlog.compare.tune.search import GENERATION, FreeParameter, free_parameters, search
from attlog.estimators import LogInfo, get
from attlog.estimators.base import Estimator, Parameter

KP, KI = FreeParameter("kp", "1/s", 0.01, 10.0, True), FreeParameter("ki", "1/s^2", 0.0, 1.0, False)
START: Setting = {"kp": 5.0, "ki": 0.9}


def bowl(settings: list[Setting]) -> np.ndarray:
    """Its minimum lies at kp 0.2, ki 0.3, with a second, higher one at kp 5."""
    kp, ki = (np.array([float(s[name]) for s in settings]) for name in ("kp", "ki"))
    away = np.log10(kp / 0.2)
    return np.minimum(away**2, 0.5 + (np.log10(kp / 5.0)) ** 2) + (ki - 0.3) ** 2


def test_the_lowest_of_several_minima_is_found() -> None:
    found = search([KP, KI], bowl, START, 12, seed=0)
    assert float(found.setting["kp"]) == pytest.approx(0.2, rel=0.05)
    assert float(found.setting["ki"]) == pytest.approx(0.3, abs=0.03)
    assert found.cost == min(c for _, c in found.tried) < 0.002


def test_the_same_seed_gives_the_same_search_and_the_start_is_tried() -> None:
    one, again, other = (search([KP, KI], bowl, START, 3, seed) for seed in (1, 1, 2))
    assert one.tried == again.tried
    assert one.tried != other.tried
    assert one.tried[0][0] == START
    assert len(one.tried) <= 4 * GENERATION


def test_generations_are_handed_over_whole() -> None:
    sizes: list[int] = []
    search([KP], lambda s: sizes.append(len(s)) or bowl([{**x, "ki": 0.3} for x in s]), START, 3, 0)  # type: ignore[func-returns-value]
    assert set(sizes) == {GENERATION}


def test_without_ranges_all_gains_with_a_default_are_looked_for() -> None:
    found = {f.name: f for f in free_parameters([], get("mahony"))}
    assert {"kp", "ki"} <= set(found)
    kp = float(get("mahony").parameter("kp").default)
    assert (found["kp"].low, found["kp"].high, found["kp"].log) == pytest.approx((kp / 20.0, kp * 20.0, True))
    assert "declination" not in found
    with pytest.raises(UsageError, match="no gains to tune"):
        free_parameters([], get("gyro"))
    with pytest.raises(UsageError, match="ekf12 has 6 numbers"):
        free_parameters([], get("ekf12"))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("kp=1", "give a range"),
        ("kp=0.1,0.2", "give a range"),
        ("kp=0.1..1/5", "attlog sweep"),
        ("kp=2..1", "smaller value first"),
        ("kp=0..1log", "begins above 0"),
        ("kp=0.1deg..1", "1/s, not in deg"),
        ("kq=0.1..1", "no parameter kq"),
        ("mag_form=heading..vector", "give a range"),
        ("kp=0.1..1000", "from 0 to 100"),
    ],
)
def test_what_is_no_range_is_refused(text: str, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        free_parameters([text], get("mahony"))


def test_values_have_three_digits_and_stay_in_the_range() -> None:
    assert KP.value(0.5) == pytest.approx(0.316)
    assert (KP.value(0.0), KP.value(1.0)) == (0.01, 10.0)
    assert KP.share(100.0) == 1.0
    assert KI.value(KI.share(0.25)) == 0.25


def gain(name: str, default: float) -> Parameter:
    return Parameter(name, default, "1/s", 0, 10, "", "")


def made(from_log) -> Estimator:
    own = (gain("w_acc", 0.2), gain("w_mag", 0.1), gain("scaled", 0.3))
    return Estimator("made", "", "", "", frozenset(), frozenset(), own, {}, start=max, step=max, from_log=from_log)


def test_a_gain_that_is_an_autopilots_parameter_is_named_so() -> None:
    def from_log(params, info: LogInfo) -> dict[str, float]:
        found = {"scaled": 2.0 * params["FW_SCALED"]} if "FW_SCALED" in params else {}
        return found | {
            own: params[name] for own, name in (("w_acc", "FW_W_ACC"), ("w_mag", "FW_W_MAG")) if name in params
        }

    assert firmware_names(made(from_log)) == {"w_acc": "FW_W_ACC", "w_mag": "FW_W_MAG"}
    assert firmware_names(get("mahony")) == {}


def test_a_function_that_wants_more_names_nothing() -> None:
    def from_log(params, info: LogInfo) -> dict[str, float]:
        assert info.imu_rate_hz is not None
        return {"w_acc": params["FW_W_ACC"]}

    assert firmware_names(made(from_log)) == {}


def test_without_scipy_the_command_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "scipy.optimize", None)
    with pytest.raises(UsageError, match="pip install scipy"):
        search([KP], bowl, START, 1, 0)
