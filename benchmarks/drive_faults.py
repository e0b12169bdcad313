"""Broken motors, propellers and outputs planted in simulated flights: is the part named, and never another?

    python benchmarks/drive_faults.py [--seeds 1] [--tlog] [--oscillations] [-v]

Every motor fails in every way of FAILURES and manner of flight of MANNERS; SOUND flights crash or fly hard with all
motors sound. Each flight is written as ULog and DataFlash log without its truth, read back, and its story is judged by
what was planted: "right" names the motor within 1 s, "wrong" names another or a sound one.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import math
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from attlog import flight, segments, story
from attlog.simulate.controller import Gains, LoopAxis, margins
from attlog.simulate.fly import fly
from attlog.simulate.logs import write
from attlog.simulate.scenario import Controller, Scenario, Vehicle, build_scenario, load_scenario
from attlog.story.control_faults import study_control

FAILS_S, WITHIN_S = 17.0, 1.0
RISE = [{"t": 4, "do": "arm"}, {"t": 5, "do": "takeoff", "up_m": 20}]
MANNERS: dict[str, dict[str, Any]] = {
    "hover": {"command": [*RISE, {"t": 14, "do": "hold"}]},
    "turning": {"command": [*RISE, {"t": 14, "do": "hold", "heading_deg": 170, "yaw_rate_dps": 40}]},
    "forward in wind": {
        "command": [*RISE, {"t": 13, "do": "velocity", "north_m_s": 4, "east_m_s": 4}],
        "wind": {"mean_ned_m_s": [-4, 2, 0], "turbulence_m_s": 1.0},
    },
    "descending, heavy": {
        "command": [*RISE, {"t": 15.5, "do": "goto", "up_m": 4, "speed_m_s": 3}],
        "vehicle": {"mass_kg": 2.1},
    },
}
FAILURES: dict[str, dict[str, Any]] = {
    "motor stops": {"part": "rotor", "kind": "stopped"},
    "propeller lost": {"part": "rotor", "kind": "off"},
    "output off": {"part": "output", "kind": "zero"},
    "output frozen": {"part": "output", "kind": "stuck"},
    "half thrust": {"part": "rotor", "kind": "scale", "factor": 0.5},
    "70 % thrust": {"part": "rotor", "kind": "scale", "factor": 0.7},
}
HELD = ("half thrust", "70 % thrust")
"""A vehicle holds these: no motor may be called broken."""
SOUND: dict[str, Any] = {
    "kill switch": {"command": [*RISE, {"t": FAILS_S, "do": "kill"}]},
    "gyro x stuck": {"command": MANNERS["hover"]["command"],
                     "fault": [{"t": FAILS_S, "part": "gyro", "kind": "offset", "value": [4.0, 0, 0]}]},
    "gyro silent": {"command": MANNERS["hover"]["command"],
                    "fault": [{"t": FAILS_S, "part": "gyro", "kind": "zero"}]},
    "rate gains too high": {"command": MANNERS["hover"]["command"], "controller": {"rate_kp": 0.8},
                            "sensors": {"imu": [{"delay_s": 0.02}]}},
    "rotors of one side": {"command": MANNERS["hover"]["command"],
                           "fault": [{"t": FAILS_S, "part": "rotor", "kind": "off", "instance": k} for k in (0, 3)]},
    "gust": {"command": MANNERS["hover"]["command"],
             "wind": {"gust": [{"t": 16, "seconds": 2, "ned_m_s": [14, 8, 3]}]}},
}  # fmt: skip
LIBRARY = ("aggressive", "steps", "waypoints", "yaw", "vibration", "hard-landing", "no-liftoff", "no-thrust-left")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--tlog", action="store_true", help="telemetry too, whose outputs are not logged")
    parser.add_argument("--oscillations", action="store_true", help="rate gains instead of motors")
    parser.add_argument("--verbose", "-v", action="store_true")
    given = parser.parse_args()
    suffixes = (".ulg", ".bin", ".tlog") if given.tlog else (".ulg", ".bin")
    counts: dict[tuple[str, str], Counter[str]] = {}
    with tempfile.TemporaryDirectory() as folder:
        if given.oscillations:
            return oscillations(Path(folder))
        for what, scenario, motor in planted(given.seeds):
            flown = fly(scenario, hash_free(scenario.name))
            for suffix in suffixes:
                path = Path(folder) / f"x{suffix}"
                write(path, flown)
                verdict, told = judged(path, motor)
                counts.setdefault((what, suffix), Counter())[verdict] += 1
                if given.verbose and verdict != ("silent" if motor is None else "right"):
                    print(f"{scenario.name}{suffix}: {verdict} {told}")
    print("| planted | log | flights | right | wrong | nothing named |")
    print("| --- | --- | --- | --- | --- | --- |")
    for (what, suffix), found in counts.items():
        print(f"| {what} | {suffix} | {found.total()} | {found['right']} | {found['wrong']} | {found['silent']} |")


# Shares of the gain margin at which rate gains are set, and delays of the gyro in s, whole periods of the loop.
GAIN_SHARES, GYRO_DELAYS_S = (0.6, 1.3, 3.0), (0.0075, 0.015, 0.025, 0.035)
MOVED = {"hover": [{"t": 10, "do": "hold"}],
         "flying": [{"t": 10, "do": "velocity", "north_m_s": 3, "east_m_s": -2},
                    {"t": 18, "do": "velocity", "north_m_s": -3, "east_m_s": 2}]}  # fmt: skip


def oscillations(folder: Path) -> None:
    """Rate gains of roll or pitch beyond the gain margin and below: is its axis named, at the phase crossover?"""
    vehicle, counts = Vehicle(), Counter[tuple[float, str]]()
    reach = vehicle.arm_m / math.sqrt(2.0)
    for axis, late, share in itertools.product((0, 1), GYRO_DELAYS_S, GAIN_SHARES):
        authority = 2.0 * vehicle.thrust_max_n * reach / vehicle.inertia_kg_m2[axis]
        margin = margins(LoopAxis(authority, vehicle.motor_lag_s, Gains.of(Controller()), axis, late + 0.0025))
        fault = {"t": 12.0, "seconds": 14.0, "part": "gain", "kind": "scale", "instance": axis}
        for moves in MOVED.values():
            values = {"seconds": 30.0, "logging": {"truth": False}, "estimator": {"name": "mekf"},
                      "sensors": {"imu": [{"delay_s": late}]}, "fault": [fault | {"factor": share * margin.gain}],
                      "command": [{"t": 4, "do": "arm"}, {"t": 5, "do": "takeoff", "up_m": 6}, *moves]}  # fmt: skip
            flown = fly(build_scenario(values | {"name": "x"}), 7 + axis)
            for suffix in (".ulg", ".bin"):
                write(folder / f"x{suffix}", flown)
                log = flight.read(folder / f"x{suffix}")
                named = study_control(log, segments.build(log)).faults.get("oscillation", [])
                hz = [float(fault.text.split(" Hz")[0].split()[-1]) for fault in named]
                own = [f.text.startswith(("Roll", "Pitch")[axis]) and abs(x / margin.gain_at * math.tau - 1.0) < 0.05
                       for f, x in zip(named, hz, strict=True)]  # fmt: skip
                counts[share, "silent" if not named else "right" if all(own) and share > 1.0 else "wrong"] += 1
    for share in GAIN_SHARES:
        print(f"| gains at {share:g} of the margin |", {what: n for (s, what), n in counts.items() if s == share})


def planted(seeds: int) -> Iterator[tuple[str, Scenario, int | None]]:
    """What is planted, the flight, and the number of the motor that broke."""
    base: dict[str, Any] = {"seconds": 24.0, "logging": {"truth": False}, "estimator": {"name": "mekf"}}
    for seed in range(1, seeds + 1):
        for what, failure in FAILURES.items():
            for manner, values in MANNERS.items():
                for k in range(4):
                    fault = {"t": FAILS_S, "instance": k} | failure
                    name = f"{what}, {manner}, motor {k + 1}, seed {seed}"
                    one = build_scenario(base | values | {"name": name.replace("/", " "), "fault": [fault]})
                    yield what, one, None if what in HELD else k + 1
        for what, values in SOUND.items():
            yield "sound motors", build_scenario(base | values | {"name": f"{what}, seed {seed}"}), None
        for name in LIBRARY:
            one = load_scenario(name)
            logging = dataclasses.replace(one.logging, truth=False)
            yield "sound motors", one.changed(name=f"{name}, seed {seed}", logging=logging), None


def hash_free(name: str) -> int:
    """A seed of a name that is the same in every process."""
    return sum((k + 1) * ord(c) for k, c in enumerate(name)) % 10_000


def judged(path: Path, motor: int | None) -> tuple[str, list[tuple[str, float, int | None]]]:
    """Whether the story names the motor, another one or none."""
    log = flight.read(path)
    told = story.events(log, segments.build(log))
    named = [(e.kind, e.t, e.motor) for e in told if e.kind.startswith("motor_")]
    wrong = [n for n in named if n[2] != motor or abs(n[1] - FAILS_S) > WITHIN_S]
    return "wrong" if wrong else "right" if named else "silent", named


if __name__ == "__main__":
    main()
