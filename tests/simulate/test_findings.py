"""What ``attlog info`` says of simulated logs: nothing of sound ones, and each planted fault by its name."""

from __future__ import annotations

from pathlib import Path

import pytest

from attlog.pipeline.inspection import inspect
from attlog.simulate.fly import fly
from attlog.simulate.logs import write
from attlog.simulate.scenario import build_scenario, scenario_names, scenario_values
from attlog.simulate.scenario_text import override_values

SUFFIXES = (".ulg", ".bin", ".tlog")
OF_TELEMETRY = {"rate", "truth_packet_times"}
"""What is always said of 50 Hz, and of a truth without a clock."""
OPEN = {"not_checked", "unanswered"}
OWN = {
    "crash": {"crash", "motor"},
    "carried-home": {"crash", "motor"},
    "flip": {"crash"},
    "roll-in": {"crash"},
    "clipping": {"vibration"},
    "hard-landing": {"hard_landing"},
    "mag-anomaly": {"compass"},
    "compass-turned": {"compass", "crash"},
    "gnss-loss": {"gnss"},
    "oscillation": {"control"},
    "vibration": {"vibration"},
}
# Judged by part and time in tests/story/test_known_parts.py.
PARTS = {
    "motor-stops",
    "output-off",
    "half-thrust",
    "weak-motor",
    "no-thrust-left",
    "gnss-height",
    "gnss-jumps",
    "accelerometer-step",
    "gyro-scale",
    "heading-step",
    "parameters-in-flight",
}
"""What a scenario plants."""
UNSEEN = {("vibration", ".tlog"): {"vibration"}}
"""Means over 20 ms do not show what rotors shake."""
SPINS = {"gyro_range"}
MAY = {
    ("crash", ".tlog"): {"reset"},
    ("roll-in", ".ulg"): SPINS,
    ("roll-in", ".bin"): SPINS,
    ("roll-in", ".tlog"): {"reset"},
    ("oscillation", ".tlog"): {"simulator"},
} | {("initial-angle", suffix): {"attitude"} for suffix in SUFFIXES}
"""Means over 20 ms smear 10 Hz, attitudes do not.

Hundreds of degrees per second at 25 Hz look like jumps; thousands go beyond a gyro's range. After 25 deg back to
level the simulated autopilot's own attitude is up to 11 deg off by the truth."""
TRUTH = "estimator.name=truth"


def found(path: Path) -> set[str]:
    return {f["kind"] for f in inspect(path)["findings"]} - OPEN - (OF_TELEMETRY if path.suffix == ".tlog" else set())


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(set(scenario_names()) - PARTS))
def test_a_named_scenario_has_the_findings_that_it_plants_and_no_other(name: str, tmp_path: Path) -> None:
    flight = fly(build_scenario(scenario_values(name)), 1)
    for suffix in SUFFIXES:
        path = tmp_path / f"{name}{suffix}"
        write(path, flight)
        planted = OWN.get(name, set()) - UNSEEN.get((name, suffix), set())
        assert planted <= found(path) <= planted | MAY.get((name, suffix), set()), suffix


def fault(**values: object) -> list[str]:
    return [f"fault.0.{key}={value}" for key, value in values.items()]


FAULTS: dict[str, tuple[str, list[str], dict[str, float], set[str]]] = {
    "swapped axes": ("steps", [TRUTH, "sensors.imu.0.rotation_deg=[0,0,90]"], {}, {"simulator"}),
    "flipped axes": ("steps", [TRUTH, *fault(t=0, part="gyro", kind="flipped")], {}, {"simulator"}),
    "gyro scale": ("steps", [TRUTH, "sensors.imu.0.gyro.scale_pct=[15,15,15]"], {}, {"gyro_scale"}),
    "gyro bias": ("hover", ["sensors.imu.0.gyro.bias_dps=[4,0,0]"], {}, {"gyro_bias"}),
    "accelerometer scale": ("hover", ["sensors.imu.0.acc.scale_pct=[8,8,8]"], {}, {"accelerometer"}),
    "tilted sensor": ("hover", [TRUTH, "sensors.imu.0.rotation_deg=[8,0,0]"], {}, {"accelerometer"}),
    "saturation": ("aggressive", [TRUTH, "sensors.imu.0.gyro.range_dps=125"], {}, {"gyro_range"}),
    "gaps": ("waypoints", [TRUTH, "sensors.imu.0.gaps=[[40,40.6],[50,50.3],[60,60.4]]"], {}, {"gaps"}),
    "vibration": ("hover", [TRUTH, "sensors.imu.0.vibration.acc_m_s2=[60,30]"], {}, {"vibration"}),
    "hidden delay": ("steps", [TRUTH, "sensors.imu.0.hidden_delay_s=0.02"], {}, {"imu_delay"}),
    "hard iron": ("waypoints", [TRUTH, "sensors.mag.0.hard_iron_ut=[30,0,20]"], {}, {"compass"}),
    "current": ("hover", [TRUTH, "sensors.mag.0.current_ut_a=[0.6,0,0.6]"], {}, {"compass"}),
    "iron at a place": (
        "waypoints",
        [TRUTH, "anomaly.0.ned_m=[20,0,-4]", "anomaly.0.field_ned_ut=[0,60,0]", "anomaly.0.radius_m=8"],
        {},
        {"compass"},
    ),
    "stuck compass": ("yaw", [TRUTH, *fault(t=0.1, part="mag", kind="stuck")], {}, {"frozen_sensors"}),
    "dead compass": ("hover", [TRUTH, *fault(t=0, part="mag", kind="zero")], {}, {"mag_dead"}),
    "compass spikes": (
        "hover",
        [TRUTH, *fault(t=5, part="mag", kind="spikes", size=0.001, share_pct=2)],
        {},
        {"compass"},
    ),
    "wrong declination": ("hover", [TRUTH], {"EKF2_MAG_DECL": 25, "COMPASS_DEC": 0.45}, {"declination"}),
    "GNSS outage": ("hover", [TRUTH, "sensors.gnss.0.outages=[[50,80]]"], {}, {"gnss"}),
    "rotor": ("hover", [TRUTH, *fault(t=40, part="rotor", kind="off")], {}, {"crash"}),
}
"""Scenario, settings, parameters, and what must be found."""


@pytest.mark.slow
@pytest.mark.parametrize("name", FAULTS)
def test_a_planted_fault_is_found(name: str, tmp_path: Path) -> None:
    scenario, settings, params, wanted = FAULTS[name]
    flight = fly(build_scenario(override_values(scenario_values(scenario), settings)), 2)
    for suffix in (".ulg", ".bin"):
        path = tmp_path / f"x{suffix}"
        write(path, flight, params)
        assert wanted <= found(path), suffix


def test_the_drivers_word_on_a_gyro_at_its_range_is_passed_on(tmp_path: Path) -> None:
    settings = [
        "seconds=12",
        "motion.move=[{seconds=2},{seconds=0.3,roll_deg=40},{seconds=1}]",
        "sensors.imu.0.gyro.range_dps=90",
    ]
    flight = fly(build_scenario(override_values(scenario_values("static"), settings)), 0)
    assert flight.imus[0].clipped[:, 0].any()
    write(tmp_path / "x.ulg", flight)
    assert "gyro_range" in found(tmp_path / "x.ulg")


@pytest.mark.slow
def test_filters_on_a_simulated_log_are_as_good_as_their_kind(tmp_path: Path) -> None:
    """Hover within a degree of tilt, steps worse where forces mislead; nothing is late, in either sampling."""
    import attlog

    tilt = {}
    for name in ("hover", "steps"):
        write(tmp_path / f"{name}.bin", fly(build_scenario(scenario_values(name)), 0))
        chosen = {"estimators": ["mahony", "gyro"], "reference": "truth"}
        rows = {row.name: row for row in attlog.analyze(tmp_path / f"{name}.bin", chosen).estimators}
        tilt[name] = rows["mahony"].metrics["airborne"]["tilt_rmse_deg"].value
    assert tilt["hover"] < 1.0
    assert tilt["hover"] < tilt["steps"] < 5.0
    for row in ("gyro", "mahony", "onboard"):
        for axis in ("roll", "pitch"):
            assert abs(rows[row].metrics["all"][f"lag_{axis}_ms"].value) < 0.2, (row, axis)
