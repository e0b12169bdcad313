"""Gates of sensors: verdicts no worse than one, values within limits, and what cannot be told."""

from __future__ import annotations

import math
from dataclasses import replace

from attlog.compare.gates.gates import Gates, judge
from attlog.compare.gates.limits import GateLimit
from attlog.compare.gates.sensors import SensorGate, judged
from attlog.result import Result
from tests.health.assessments.made import MADE, OFFSET, REFUSED, SILENT, SOUND


def statuses(gate: SensorGate) -> dict[str, str]:
    return {outcome.row: outcome.status for outcome in judged(gate, MADE)}


def test_a_value_is_held_against_its_limit_by_its_size():
    five, thirty = (GateLimit("max", value) for value in (5.0, 30.0))
    for value, limit, status in ((24.0, five, "failed"), (-24.0, five, "failed"), (-24.0, thirty, "passed")):
        (found,) = judged(SensorGate("compass_offset", (limit,)), [replace(OFFSET, value=value)])
        assert (found.status, found.value, found.allowed) == (status, value, limit.value)
    assert judged(SensorGate("compass_offset", (five,)), [OFFSET])[0].excess == 24.0 / 5.0


def test_a_least_value_is_asked_of_the_value_itself():
    few = replace(SOUND, question="gnss_quality", value=6.0, unit="")
    assert [o.status for o in judged(SensorGate("gnss_quality", (GateLimit("min", 8.0),)), [few])] == ["failed"]
    assert [o.status for o in judged(SensorGate("gnss_quality", (GateLimit("min", 6.0),)), [few])] == ["passed"]


def test_the_worst_verdict_allowed_is_allowed_and_no_worse_one():
    assert statuses(SensorGate("compass_offset", worst="warning")) == {"MAG.0": "passed"}
    assert statuses(SensorGate("compass_offset", worst="ok")) == {"MAG.0": "failed"}
    assert statuses(SensorGate("compass_motors", worst="warning")) == {"MAG.1": "failed"}
    assert statuses(SensorGate("vibration_level", worst="ok")) == {"IMU.0": "passed"}


def test_what_cannot_be_told_fails_unless_unknown_passes_and_is_never_counted_as_passed():
    for question in ("gnss_delay", "notch"):  # asked without an answer, and not asked
        strict, lenient = (SensorGate(question, worst="ok", unknown_passes=passes) for passes in (False, True))
        assert set(statuses(strict).values()) == {"failed"}
        assert set(statuses(lenient).values()) == {"skipped"}
    (found,) = judged(SensorGate("gnss_delay", (GateLimit("max", 1.0),)), [SILENT])
    assert found.excess == math.inf
    assert SILENT.text in found.sentence


def test_an_answer_without_a_number_keeps_no_limit():
    words = replace(REFUSED, value=None, verdict="ok")
    assert [o.status for o in judged(SensorGate("compass_motors", (GateLimit("max", 99.0),)), [words])] == ["failed"]
    assert [o.status for o in judged(SensorGate("compass_motors", worst="ok"), [words])] == ["passed"]


def test_only_the_sensors_that_are_named_are_judged():
    both = [OFFSET, replace(OFFSET, sensor="MAG.1", value=1.0)]
    gate = SensorGate("compass_offset", (GateLimit("max", 5.0),), sensors=("MAG.1",))
    assert [(o.row, o.status) for o in judged(gate, both)] == [("MAG.1", "passed")]
    assert len(judged(replace(gate, sensors=("MAG.*",)), both)) == 2
    (missing,) = judged(replace(gate, sensors=("MAG.7",)), both)
    assert (missing.status, missing.row) == ("failed", "MAG.7")


def test_gates_of_sensors_stand_among_the_others_worst_first():
    result = Result({}, "", {}, {}, health=list(MADE))
    gates = (SensorGate("vibration_level", worst="ok"), SensorGate("compass_offset", (GateLimit("max", 5.0),)))
    found = judge(Gates(health=gates), result)
    assert [o.check for o in found] == ["health.compass_offset max=5", "health.vibration_level verdict=ok"]
    assert found[0].sentence == "MAG.0: compass_offset 24.0 µT, at most 5 µT"
