"""Simulated flights whose broken part and time are known: the part is named, at its time, and no other."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

import attlog
from attlog.result import Result
from attlog.simulate.flight import Flight
from attlog.simulate.fly import fly
from attlog.simulate.logs import write
from attlog.simulate.scenario import LoggingRates, load_scenario

pytestmark = pytest.mark.slow
SUFFIXES = (".ulg", ".bin")


@dataclass(frozen=True)
class Part:
    """What is said of a scenario (patterns), what is not, and events by kind with their time [s]."""

    said: tuple[str, ...] = ()
    never: tuple[str, ...] = ()
    events: tuple[tuple[str, float], ...] = ()
    fault: bool = True


NOTHING_WRONG = r"Nothing went wrong"
OTHER_MOTORS = r"[Mm]otor [{}] \([a-z ]+\) (gave|had|is|was|went)"
PARTS = {
    "motor-stops": Part((r"[Mm]otor 2 \(rear left\)",), (OTHER_MOTORS.format("134"),), (("motor.*", 38.0),)),
    "crash": Part((r"[Mm]otor 2 \(rear left\)",), (OTHER_MOTORS.format("134"),), (("motor.*", 38.0),)),
    "output-off": Part((r"[Mm]otor 1 \(front right\)",), (OTHER_MOTORS.format("234"),), (("(motor|output).*", 38.0),)),
    "half-thrust": Part(never=(r"no thrust", r"failed"), fault=False),
    "weak-motor": Part((r"[Mm]otor 4",), (r"no thrust", r"will fail"), fault=False),
    "no-thrust-left": Part((r"thrust",), (NOTHING_WRONG, r"landed safely")),
    "gnss-height": Part((r"GNSS.*height|height.*GNSS",), (NOTHING_WRONG,)),
    "gnss-jumps": Part(
        (r"GNSS.*jump|jump.*GNSS",), (NOTHING_WRONG, r"\b(7|[1-9]\d) times"), (("gnss_jump|sensor_fault", 42.0),)
    ),
    "accelerometer-step": Part((r"[Aa]ccelerometer",), (NOTHING_WRONG,)),
    "gyro-scale": Part((r"[Gg]yro.*scale|z.*too much|[Gg]yro.*turns",), (r"[Cc]alibrate the compass",)),
    "heading-step": Part((r"(160|159|161)°",), (NOTHING_WRONG, r"[Cc]alibrate the compass")),
    "parameters-in-flight": Part((r"AHRS_ORIENTATION|SENS_BOARD_ROT",), (NOTHING_WRONG,)),
}


@cache
def flown(name: str) -> Flight:
    """The scenario without its truth in the log."""
    scenario = load_scenario(name)
    return fly(scenario.changed(logging=LoggingRates(truth=False)), 1)


@cache
def analysed(name: str, suffix: str, folder: Path) -> Result:
    """The analysed log of a scenario."""
    write(folder / f"{name}{suffix}", flown(name))
    return attlog.analyze(folder / f"{name}{suffix}")


def statements(result: Result) -> list[str]:
    """The headline, events, findings with cause, action and evidence."""
    lines = [result.headline, *(e.text for e in result.events)]
    for finding in result.findings:
        lines += [finding.text, finding.cause, finding.action, *finding.evidence]
    lines += [check.text for check in result.checks if check.verdict in ("note", "warning", "fault")]
    return [line for line in lines if line and not line.startswith("“simulated")]


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("name", PARTS)
def test_the_part_that_broke_is_named_and_no_other(
    name: str, suffix: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    result, part = analysed(name, suffix, tmp_path_factory.getbasetemp()), PARTS[name]
    lines = statements(result)
    missing = [x for x in part.said if not any(re.search(x, line) for line in lines)]
    false = [line for x in part.never for line in lines if re.search(x, line)]
    late = [
        (kind, at)
        for kind, at in part.events
        if not any(re.fullmatch(kind, e.kind) and abs(e.t - at) < 1.0 for e in result.events)
    ]
    assert (missing, false, late) == ([], [], []), result.headline
