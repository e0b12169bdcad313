"""Flights made worse on purpose: each fault is caught by the gate meant for it, and by none of the others."""

from __future__ import annotations

from pathlib import Path

import pytest

import attlog
from attlog import segments
from attlog.compare.gates import baseline
from attlog.compare.gates import file as gate_file
from attlog.compare.gates.gates import judge
from attlog.compare.gates.outcome import GateOutcome
from tests.compare import faulty
from tests.conftest import SAMPLES, few

GATES = """
[gates]
lag_ms = { max = 5, filters = ["mekf"], optional = true }
step_error_pct.0.5s = { max = 2.5, filters = ["mekf"] }
drift_air_deg_per_min.truth = { max = 10, filters = ["mekf"] }
total_p95_deg = { max = 30, filters = ["mekf"] }
"""
LAG, STEP, DRIFT = "lag_ms max=5", "step_error_pct.0.5s max=2.5", "drift_air_deg_per_min.truth max=10"
TOTAL = "total_p95_deg max=30"
SAMPLE_FLIGHTS = ("px4_steps.ulg", "copter_steps_stabilize.bin")
FLIGHTS = (
    *SAMPLE_FLIGHTS,
    *(pytest.param(f"px4_{n}.ulg", marks=pytest.mark.slow) for n in ("yaw", "aggressive", "wind")),
)


def original(flight: str, request: pytest.FixtureRequest) -> Path:
    """A flight of the samples, else of the corpus."""
    sample = SAMPLES / flight
    return sample if sample.exists() else request.getfixturevalue("corpus") / "sitl" / "px4" / flight


def found(flight: Path, folder: Path, fault: str) -> list[GateOutcome]:
    """The gates that fail on a flight with a fault; a bias begins 5 s after take-off."""
    read = attlog.read(flight)
    start = read.t0_us / 1e6 + segments.build(read).of("airborne")[0].t0 + 5.0
    log = faulty.write(flight, folder / f"flight{flight.suffix}", fault, start)
    (folder / "gates.toml").write_text(GATES)
    result = attlog.analyze(log, {"estimators": ["mekf"], "reference": "truth"})
    return [o for o in judge(gate_file.read(folder / "gates.toml"), result) if o.status == "failed"]


@pytest.mark.parametrize("flight", few(FLIGHTS, 1))
@pytest.mark.parametrize(
    ("fault", "check"), few([("as it was", None), ("bias", DRIFT), ("delay", LAG), ("scale", STEP)], 2)
)
def test_a_fault_is_caught_by_its_gate_alone(
    request: pytest.FixtureRequest, tmp_path: Path, flight: str, fault: str, check: str | None
) -> None:
    outcomes = found(original(flight, request), tmp_path, fault)
    assert {(o.check, o.cause) for o in outcomes} == ({(check, "limit")} if check else set()), outcomes


@pytest.mark.parametrize("flight", few(FLIGHTS, 1))
def test_a_swapped_axis_is_a_row_that_is_lost_and_no_lag_step_or_drift(
    request: pytest.FixtureRequest, tmp_path: Path, flight: str
) -> None:
    outcomes = found(original(flight, request), tmp_path, "swap")
    assert {(o.row, o.cause) for o in outcomes} == {("mekf", "row")}
    assert "status" in {o.check for o in outcomes}
    assert all("diverged: heading error above 45 deg" in o.sentence for o in outcomes)


@pytest.mark.slow
def test_a_swapped_gyro_fails_every_gate_that_asks_and_its_axes_are_told(tmp_path: Path) -> None:
    outcomes = found(SAMPLES / "px4_steps.ulg", tmp_path, "swapped gyro")
    assert {STEP, DRIFT, TOTAL} <= {o.check for o in outcomes}
    assert all("the gyro's x is the attitude's y, y is the attitude's x" in o.sentence for o in outcomes)


@pytest.mark.slow
@pytest.mark.parametrize(("gain", "passes"), few([(0.501, True), (1.5, False)], 1), ids=["a hair", "three times"])
def test_a_changed_gain_is_paired_with_the_run_before(tmp_path: Path, gain: float, passes: bool) -> None:
    def run(kp: float) -> attlog.Result:
        settings = {"reference": "truth", "estimators": [f"mahony:kp={kp}"]}
        result = attlog.analyze(SAMPLES / "px4_steps.ulg", settings)
        result.estimators = [row for row in result.estimators if row.estimator == "mahony"]
        result.estimators[0].name = "mahony"
        return result

    run(0.5).to_json(tmp_path / "main.json")
    (tmp_path / "gates.toml").write_text('[gates]\nbaseline="main.json"\ninclination_rmse_deg={baseline=true}\n')
    read = gate_file.read(tmp_path / "gates.toml")
    outcomes = judge(read, run(gain), baseline.read_all(gate.baseline for gate in read.gates))
    assert [o.status for o in outcomes if o.check != "status"] == ["passed" if passes else "failed"], outcomes
