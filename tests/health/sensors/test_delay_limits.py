"""How late the gyro is beside what its filter explains: the limits on either side, from a delay that is given."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.flight.model import Imu, Stream
from attlog.health.model import Check
from attlog.health.sensors import delay


def checks(
    monkeypatch: pytest.MonkeyPatch,
    late_ms: float | None,
    sigma_ms: float = 0.0,
    own_ms: float = 0.0,
    filtered: str = "low-pass 30 Hz",
    kind: str = "truth",
) -> tuple[Check, Check]:
    t = np.arange(3.0)
    gyro = Stream(t, np.zeros((3, 3)), "rad/s", "FRD", "GYR", delay=1e-3 * own_ms)
    log: Any = SimpleNamespace(imus=[Imu(0, gyro, gyro, filtered=filtered)], imu=0)
    reference: Any = SimpleNamespace(kind=kind, source="TRUTH")
    seen = None if late_ms is None else (1e-3 * late_ms, 1e-3 * sigma_ms)
    monkeypatch.setattr(delay.delay, "measured", lambda imu, reference: seen)
    own, unexplained = delay.checks(log, reference)
    return own, unexplained


@pytest.mark.parametrize(
    ("off_ms", "verdict"),
    [
        (-20.1, "fault"),
        (-19.9, "warning"),
        (-4.1, "warning"),
        (-3.9, "ok"),
        (0.0, "ok"),
        (3.9, "ok"),
        (4.1, "warning"),
        (19.9, "warning"),
        (20.1, "fault"),
    ],
)
@pytest.mark.parametrize("own_ms", [0.0, 5.0])
def test_beside_a_named_filter_four_milliseconds_are_allowed_both_ways(
    monkeypatch: pytest.MonkeyPatch, off_ms: float, verdict: str, own_ms: float
) -> None:
    _, found = checks(monkeypatch, own_ms + off_ms, own_ms=own_ms)
    assert (found.verdict, found.value) == (verdict, pytest.approx(own_ms + off_ms))
    if verdict != "ok":
        assert f"comes {abs(off_ms):.1f} ms {'later' if off_ms > 0 else 'earlier'} " in found.text
        low, high = abs(off_ms) - 1.96 * 0.5, abs(off_ms) + 1.96 * 0.5
        assert f"({low:.1f} to {high:.1f}, 95 %)" in found.text


@pytest.mark.parametrize("filtered", ["unknown", "driver"])
def test_what_no_filter_is_named_for_may_be_ten_milliseconds_late_and_four_early(
    monkeypatch: pytest.MonkeyPatch, filtered: str
) -> None:
    for late, verdict in ((-4.1, "warning"), (-3.9, "ok"), (9.9, "ok"), (10.1, "warning")):
        own, found = checks(monkeypatch, late, filtered=filtered)
        assert (own.verdict, found.verdict) == ("unknown", verdict)


@pytest.mark.parametrize(("sigma_ms", "verdict"), [(1.5, "ok"), (1.3, "warning")])
def test_four_sigmas_of_half_a_millisecond_and_the_fits_own_are_no_delay(
    monkeypatch: pytest.MonkeyPatch, sigma_ms: float, verdict: str
) -> None:
    """8.5 ms beside 4 hypot(1.5 sigma, 0.5): 9.2 and 8.05 ms."""
    assert checks(monkeypatch, 8.5, sigma_ms)[1].verdict == verdict
    assert checks(monkeypatch, -8.5, sigma_ms)[1].verdict == verdict


def test_an_onboard_attitude_that_comes_later_accuses_no_imu(monkeypatch: pytest.MonkeyPatch) -> None:
    for kind, off, verdict in (("onboard", -9.0, "ok"), ("onboard", 9.0, "warning"), ("truth", -9.0, "warning")):
        assert checks(monkeypatch, off, kind=kind)[1].verdict == verdict


def test_a_filter_of_more_than_six_milliseconds_is_a_warning_and_none_is_told_as_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for own_ms, verdict in ((5.9, "ok"), (6.1, "warning"), (600.0, "warning")):
        own, _ = checks(monkeypatch, own_ms, own_ms=own_ms)
        assert (own.verdict, own.value) == (verdict, own_ms)
    assert "without a low-pass" in checks(monkeypatch, 0.0)[0].text
    assert checks(monkeypatch, None)[1].verdict == "unknown"
