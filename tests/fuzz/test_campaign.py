"""Broken logs through the whole of attlog: documented exit codes, sound JSON, no impossible number, time and memory."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from tests.conftest import SAMPLES
from tests.fuzz import campaign, verdict
from tests.fuzz.campaign import Trial, run, trials

CUTS = {"px4_steps.ulg": 500_000, "copter_yaw_turns.bin": 300_000, "copter_steps_stabilize.tlog": 250_000}
RUNS = 21


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The first seconds of the samples: an analysis of them takes a fraction of a second."""
    campaign.warm()
    folder = tmp_path_factory.mktemp("cut")
    for name, length in CUTS.items():
        (folder / name).write_bytes((SAMPLES / name).read_bytes()[:length])
    return [folder / name for name in CUTS]


@pytest.mark.slow
def test_broken_logs_end_as_documented(logs: list[Path], tmp_path: Path) -> None:
    commands = ("analyze", "analyze", "analyze", "info", "extract", "report")
    faults = []
    for trial in itertools.islice(trials(logs, 7, commands), RUNS):
        faults += [f"{trial}: {fault}" for fault in run(trial, tmp_path).faults]
    assert faults == []


def test_whole_logs_have_no_fault(logs: list[Path], tmp_path: Path) -> None:
    for log in logs:
        outcome = run(Trial(log, "whole", 0, "analyze"), tmp_path)
        assert (outcome.code, outcome.faults) == (0, [])


@pytest.mark.parametrize(
    ("document", "says"),
    [
        ({"rate_hz": 250_000.0}, ".rate_hz"),
        ({"audit": [{"value": 1e34, "unit": "uT"}]}, ".audit[0].value"),
        ({"delay_ms": 1e42}, ".delay_ms"),
        ({"place": {"alt_m": -23_889.0}}, ".place.alt_m"),
        ({"segments": [{"t1": 1e12}]}, ".segments[0].t1"),
    ],
    ids=lambda x: x if isinstance(x, str) else "",
)
def test_the_judge_sees_what_no_flight_has(document: dict[str, object], says: str) -> None:
    assert [x.partition(" ")[0] for x in verdict.unphysical(document)] == [says]
    assert list(verdict.unphysical({"rate_hz": 250.0, "params": {"X": 1e38}, "value": 3.0, "unit": "deg"})) == []
    assert verdict.wrong('{"x": NaN}') == ["no JSON: NaN in a result"]


def test_a_crash_a_hang_and_a_wrong_exit_code_are_faults(
    logs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trial = Trial(logs[1], "whole", 0, "analyze")

    def crash(*args: object) -> tuple[int, list[str]]:
        raise RuntimeError("nobody thought of this")

    def spin(*args: object) -> tuple[int, list[str]]:
        while True:
            pass

    def odd(*args: object) -> tuple[int, list[str]]:
        return 3, []

    monkeypatch.setattr(campaign, "SECONDS", 0.2)
    monkeypatch.setattr(campaign, "SECONDS_PER_MB", 0.0)
    for broken, says in ((crash, "nobody thought of this"), (odd, "exit code 3"), (spin, "more than")):
        monkeypatch.setattr(campaign, "_commanded", broken)
        assert says in "".join(run(trial, tmp_path).faults)
