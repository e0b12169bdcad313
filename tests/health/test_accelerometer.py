"""Offsets in flight: what is offered, and every reason for which nothing is."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import FlightLog, Imu, Stream, TimeLine
from attlog.health import accelerometer
from attlog.health.accelerometer import accelerometer_offsets
from attlog.health.check import Check, Setting
from attlog.health.settings import Proposal
from attlog.segments import Segment, Segments
from tests.health.imu_cases import case, log_of, phases, told, unit

NONE = (0.0, 0.0, 0.0)
Asked = list[tuple[str, list[float]]]


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> Asked:
    """What the parameters are asked for; they take everything."""
    calls: Asked = []

    def proposal(log: FlightLog, imu: Imu, bias: np.ndarray) -> Proposal:
        calls.append((imu.acc.source, [round(float(v), 2) for v in bias]))
        return Proposal([Setting("OFFSET", 0.0, float(bias.sum()))])

    monkeypatch.setattr(accelerometer, "accelerometer_proposal", proposal)
    return calls


def test_an_offset_is_offered_along_the_axes_that_are_off_only(asked: Asked) -> None:
    (found,) = accelerometer_offsets(case(log_of(unit(0, 100.0, (0.3, 0.05, 0.0), NONE)), told((0.3, 0.05, 0.0))))
    assert found.verdict == "warning"
    assert asked == [("IMU:0", [0.3, 0.0, 0.0])]
    assert [s.name for s in found.settings] == ["OFFSET"]
    assert "level" in found.action
    assert found.ci95 is not None
    assert found.ci95 == pytest.approx((0.3 - 1.96 * 0.0335, 0.3 + 1.96 * 0.0335), abs=1e-3)


@pytest.mark.parametrize(("more", "verdict"), [(0.4, "warning"), (0.9, "fault"), (1.7, "fault")])
def test_another_unit_has_the_bias_of_the_first_and_what_it_reads_more(asked: Asked, more: float, verdict: str) -> None:
    """By the difference its size may be large; 0.4 m/s^2 are also 2.3 deg between the units."""
    log = log_of(unit(0, 100.0, (0.1, 0.0, 0.0), NONE), unit(1, 50.0, (more, 0.0, 0.0), NONE))
    first, second = accelerometer_offsets(case(log, told((0.1, 0.0, 0.0))))
    assert (first.verdict, second.verdict) == ("ok", verdict)
    assert second.vector == pytest.approx([more, 0.0, 0.0], abs=0.03)
    assert [name for name, _ in asked] == (["IMU:1"] if more > 0.5 else [])
    assert bool(second.why_no_setting) == (more < 0.5)


def test_without_a_rest_on_the_ground_nothing_is_offered_along_z(asked: Asked) -> None:
    air = Segments([Segment("airborne", 30.0, 90.0)])
    (found,) = accelerometer_offsets(
        case(log_of(unit(0, 100.0, (0.0, 0.0, 0.5), NONE)), told((0.0, 0.0, 0.5)), segments=air)
    )
    assert not asked
    assert "before arming" in found.why_no_setting


@pytest.mark.parametrize(
    ("quality", "checks"),
    [
        (told((1.2, 0.0, 0.0)), []),
        (told((0.3, 0.0, 0.0)), [Check("vibration_level", "fault", "It shakes.")]),
        (told((0.3, 0.0, 0.0)), [Check("force_axes", "fault", "x and y are exchanged.")]),
    ],
    ids=["beyond the prior", "vibration", "axes"],
)
def test_what_is_not_exact_or_shaken_is_told_and_not_offered(
    asked: Asked, quality: dict[str, float | str], checks: list[Check]
) -> None:
    x = float(quality["acc_bias_x_m_s2"])
    (found,) = accelerometer_offsets(case(log_of(unit(0, 100.0, (x, 0.0, 0.0), NONE)), quality, checks=checks))
    assert found.verdict in ("warning", "fault")
    assert not found.settings
    assert not asked
    assert found.why_no_setting


def test_a_stream_that_follows_the_unit_in_use_has_no_offset_of_its_own_after_a_switch(asked: Asked) -> None:
    log = log_of(unit(0, 100.0, (0.3, 0.0, 0.0), NONE))
    log.imu_that_flew = TimeLine(np.array([0.0, 50.0]), [0, 1], "made")
    (found,) = accelerometer_offsets(case(log, told((0.3, 0.0, 0.0))))
    assert (found.verdict, asked) == ("warning", [])
    assert "changed" in found.why_no_setting


def test_an_offset_below_four_of_its_sigmas_is_none(asked: Asked) -> None:
    """0.19 m/s^2 where 1.5 times 0.028 and 0.03 make 0.052."""
    (found,) = accelerometer_offsets(case(log_of(unit(0, 100.0, NONE, NONE)), told((0.19, 0.0, 0.0), sigma=0.028)))
    assert (found.verdict, asked) == ("ok", [])


@pytest.mark.parametrize("sigma", [0.035, 0.2])
def test_a_flight_that_hardly_turns_tells_nothing_of_the_horizontal_axes(asked: Asked, sigma: float) -> None:
    """Two simulated flights that stand still have -0.8 m/s^2 with a sigma of 0.09 where 0.1 is true."""
    (found,) = accelerometer_offsets(case(log_of(unit(0, 100.0, NONE, NONE)), told((-0.8, 0.0, 0.0), sigma)))
    assert (found.verdict, asked) == ("unknown", [])
    assert found.action


def test_no_flight_no_gnss_and_damaged_words_are_unknown_with_the_reason() -> None:
    log = log_of(unit(0, 100.0, NONE, NONE))
    for one in (
        case(log, segments=Segments([Segment("rest.long", 0.0, 28.0)])),
        case(log),
        case(log, told((0.3, 0.0, 0.0)) | {"acc_bias_x_m_s2": float("nan")}, segments=phases()),
    ):
        (found,) = accelerometer_offsets(one)
        assert found.verdict == "unknown"
        assert found.action


@pytest.mark.parametrize(
    ("flown", "on_ground", "offered"),
    [
        (0.8, 0.8 - 0.22, True),
        (0.8, 0.8 - 0.26, False),
        (0.8, 0.8 + 0.22, True),
        (0.8, 0.8 + 0.26, False),
        (-0.8, -0.8 + 0.22, True),
        (-0.8, -0.8 + 0.26, False),
        (0.32, 0.32 - 0.085, True),
        (0.32, 0.32 - 0.11, False),
    ],
)
def test_the_ground_confirms_an_offset_to_three_tenths_of_it_or_a_tenth(
    asked: Asked, flown: float, on_ground: float, offered: bool
) -> None:
    (found,) = accelerometer_offsets(case(log_of(unit(0, 100.0, (0.0, 0.0, on_ground), NONE)), told((0.0, 0.0, flown))))
    assert found.verdict == "warning"
    assert (bool(asked), "no constant offset" in found.why_no_setting) == (offered, not offered)


@pytest.mark.parametrize(("size", "offered"), [(0.98, True), (-1.02, False)])
def test_an_offset_is_offered_up_to_a_metre_per_second_squared(asked: Asked, size: float, offered: bool) -> None:
    (found,) = accelerometer_offsets(case(log_of(unit(0, 100.0, (0.0, size, 0.0), NONE)), told((0.0, size, 0.0))))
    assert (bool(asked), "six positions do" in found.why_no_setting) == (offered, not offered)
    assert found.verdict == "fault"


@pytest.mark.parametrize(
    ("offset", "verdict"),
    [
        ((0.165, 0.0, 0.0), "ok"),
        ((0.0, -0.175, 0.0), "warning"),
        ((0.0, 0.0, 0.29), "ok"),
        ((0.0, 0.0, -0.31), "warning"),
        ((0.495, 0.0, 0.0), "warning"),
        ((0.505, 0.0, 0.0), "fault"),
        ((0.0, 0.0, 0.99), "warning"),
        ((0.0, 0.0, 1.01), "fault"),
    ],
)
def test_limits_of_an_offset_are_wider_along_z(asked: Asked, offset: tuple[float, float, float], verdict: str) -> None:
    (found,) = accelerometer_offsets(case(log_of(unit(0, 100.0, offset, NONE)), told(offset)))
    assert found.verdict == verdict
    assert found.value == pytest.approx(max(offset, key=abs), abs=1e-3)


@pytest.mark.parametrize(
    ("at_rest", "onboard", "verdict", "offered"),
    [
        (0.3, None, "warning", True),
        (0.3, 0.25, "warning", True),
        (0.3, 0.02, "warning", False),
        (0.0, 0.25, "warning", False),
        (0.0, -0.01, "unknown", False),
        (0.0, None, "unknown", False),
        (None, None, "warning", False),
        (None, -0.01, "unknown", False),
        (1.7, None, "warning", False),  # on a tail wheel
    ],
)
def test_a_value_needs_rest_and_the_onboard_bias_and_a_fault_needs_one(
    asked: Asked, at_rest: float | None, onboard: float | None, verdict: str, offered: bool
) -> None:
    log = log_of(unit(0, 100.0, (at_rest or 0.0, 0.0, 0.0), NONE))
    if onboard is not None:
        t = np.arange(0.0, 120.0, 0.1)
        log.estimator.acc_bias = Stream(t, np.tile([onboard, 0.0, 0.0], (len(t), 1)), "m/s^2", "FRD", "XKF2")
    segments = Segments([Segment("airborne", 30.0, 90.0)]) if at_rest is None else phases()
    (found,) = accelerometer_offsets(case(log, told((0.3, 0.0, 0.0)), segments=segments))
    assert (found.verdict, bool(asked)) == (verdict, offered)


@pytest.mark.parametrize(("onboard", "verdict"), [(0.38, "fault"), (0.0, "unknown"), (0.1, "unknown")])
def test_an_estimator_that_learns_as_much_as_it_may_confirms_a_larger_offset(
    asked: Asked, onboard: float, verdict: str
) -> None:
    log = log_of(unit(0, 100.0, NONE, NONE))
    t = np.arange(0.0, 120.0, 0.1)
    log.estimator.acc_bias = Stream(t, np.tile([onboard, 0.001, 0.0], (len(t), 1)), "m/s^2", "FRD", "bias")
    log.parameters.lines["EKF2_ABL_LIM"] = TimeLine(np.zeros(1), [0.4], "PARM")
    segments = Segments([Segment("airborne", 30.0, 90.0)])
    (found,) = accelerometer_offsets(case(log, told((0.9, 0.0, 0.0)), segments=segments))
    assert found.verdict == verdict


@pytest.mark.parametrize(("rate", "judged"), [(9.5, 1), (10.5, 2)])
def test_the_lowest_rate_of_another_unit_that_is_compared(asked: Asked, rate: float, judged: int) -> None:
    log = log_of(unit(0, 100.0, NONE, NONE), unit(1, rate, (0.9, 0.0, 0.0), NONE))
    assert len(accelerometer_offsets(case(log, told(NONE)))) == judged
