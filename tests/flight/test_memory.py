"""A log that the machine cannot hold is refused before the work, in a sentence with numbers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from attlog import analyze
from attlog.analysis.inspection import inspect
from attlog.base.errors import TooLittleMemory, exit_code, message
from attlog.flight import memory as room
from attlog.flight import read
from attlog.formats.base import Messages, Table
from tests.conftest import SAMPLES


def log_of(samples: int, name: str = "sensor_combined") -> Messages:
    offsets = np.broadcast_to(np.int64(0), samples)
    table = Table(name, 0, {}, offsets, lambda *_: np.zeros(0))
    return Messages(Path("long.ulg"), "ulog", 2 << 30, {(name, 0): table})


def test_samples_beyond_the_memory_are_refused_with_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "free_bytes", lambda: 4_000_000_000)
    room.check(log_of(4_000_000_000 // room.FLIGHT))
    with pytest.raises(TooLittleMemory, match=r"long.ulg: needs some 5\.1 GB .* 30,000,000 .* 4\.0 GB are free"):
        room.check(log_of(30_000_000))


@pytest.mark.parametrize("work", [inspect, analyze])
def test_what_is_made_of_a_flight_is_asked_for_too(
    work: Callable[[Path], object], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(room, "SMALL", 0)
    samples = len(read(SAMPLES / "px4_hover.ulg").imus[0].gyro.t)
    monkeypatch.setattr(room, "free_bytes", lambda: samples * room.FLIGHT)  # enough to read it
    with pytest.raises(TooLittleMemory, match=r"px4_hover\.ulg: needs"):
        work(SAMPLES / "px4_hover.ulg")


def test_what_is_short_or_has_no_inertial_samples_or_nobody_tells_is_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "free_bytes", lambda: 0)
    room.check(log_of(room.SMALL))
    room.check(log_of(20_000_000, "actuator_outputs"))
    monkeypatch.setattr(room, "free_bytes", lambda: None)
    room.check(log_of(20_000_000))


def test_memory_that_runs_out_is_no_bug_of_attlog() -> None:
    error = MemoryError("Unable to allocate 16.8 MiB")
    assert exit_code(error) == exit_code(TooLittleMemory("x")) == 75
    said = message(error, "1.0", "long.ulg")
    assert said.startswith("attlog: long.ulg: memory ran out")
    assert "bug" not in said
