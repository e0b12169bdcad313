"""What a log tells estimators: declination and noise as facts, GNSS, barometer, airspeed and rest as aids."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import attlog
from attlog import segments
from attlog.core import earth
from attlog.core.errors import UsageError
from attlog.estimators import Aids, Estimate, Measurements
from attlog.flight.model import Firmware, FlightLog, Gnss, Imu, Stream, TimeLine
from attlog.pipeline import inputs, replay
from attlog.reference import ReferenceOptions
from attlog.segments.model import Segment, Segments
from tests.flight.made_log import with_fields
from tests.reference.flights import flight as flown_log

SAMPLES = Path(__file__).parents[2] / "sample_logs"
REST = Segments([Segment("rest.long", 0.0, 30.0), Segment("rest.short", 40.0, 45.0)])
nan = np.nan


def imu(rate: float, gyro_density: float = 1e-3, acc_density: float = 2e-2) -> Imu:
    """A minute of white noise with a slow drift, shaken hard outside rest."""
    random = np.random.default_rng(3)
    t = np.arange(int(60 * rate)) / rate
    shake = np.where((t > 30.5) & (t < 39.5) | (t > 45.5), 5.0, 0.0)[:, None]
    noise = [random.standard_normal((len(t), 3)) * (d * np.sqrt(rate)) for d in (gyro_density, acc_density)]
    moved = shake * random.standard_normal((len(t), 3))
    gyro, acc = noise[0] + 0.01 * t[:, None] / 60.0 + moved, noise[1] + [0.0, 0.0, -9.8] + moved
    return Imu(0, Stream(t, gyro, "rad/s", "FRD", "test"), Stream(t, acc, "m/s^2", "FRD", "test"))


def flight(**parts: Any) -> FlightLog:
    return with_fields(FlightLog(Path("x.bin"), "dataflash", 0, 0, Firmware("ArduPilot"), "QUADROTOR"), **parts)


@pytest.mark.parametrize("rate", [50.0, 400.0])
def test_noise_densities_at_rest_are_those_of_the_sensor_at_any_rate(rate: float) -> None:
    gyro, acc, seconds = inputs.noise_at_rest(imu(rate), REST)
    assert gyro == pytest.approx(1e-3, rel=0.05)
    assert acc == pytest.approx(2e-2, rel=0.05)
    assert seconds == pytest.approx(35.0, abs=0.2)


def test_without_rest_no_noise_is_known() -> None:
    assert inputs.noise_at_rest(imu(100.0), Segments([])) == (None, None, 0.0)


def test_facts_hold_the_numbers_among_the_parameters_and_what_is_known() -> None:
    unit = imu(100.0)
    log = flight(
        imus=[unit],
        lines={"A": TimeLine(np.array([-5.0, 20.0]), [1, 2], "PARM"), "B": TimeLine(np.array([0.0]), ["text"], "PARM")},
    )
    facts = inputs.facts_of(log, REST, unit, 3.5)
    assert dict(facts.params) == {"A": 1.0}
    assert facts.info.declination_deg == 3.5
    assert facts.info.mag_rate_hz is None
    assert facts.info.imu_rate_hz == pytest.approx(100.0)


def receiver(**changes: Any) -> Gnss:
    n = 6
    parts = {
        "index": 0,
        "t": np.array([0.0, 1.0, 2.0, 2.0, 1.5, 3.0]),
        "source": "GPS:0",
        "lat": np.array([50.0, 50.1, 50.2, 59.0, 50.4, nan]),
        "lon": np.full(n, 8.0),
        "alt": np.full(n, nan),
        "vel_ned": np.column_stack([np.arange(6.0), np.zeros(6), np.full(6, nan)]),
        "h_acc": np.full(n, 1.5),
        "v_acc": np.full(n, nan),
        "s_acc": np.array([0.1, 0.2, 0.3, 9.0, -1.0, 0.6]),
        "fix": np.array([1, 3, 3, 3, 4, 3]),
    }
    return Gnss(**(parts | changes))


def test_fixes_are_those_that_tell_something_in_the_order_of_time() -> None:
    """No fix at 0 s, a doubled time at 2 s, one sample out of order, no position at 3 s."""
    aids = inputs.aids_of(flight(gnss=[receiver(fix=np.zeros(6, np.int64)), receiver()]), REST)
    assert aids.position is not None
    assert aids.position.t.tolist() == [1.0, 1.5, 2.0]
    assert aids.position.x[:, 0].tolist() == [50.1, 50.4, 50.2]
    assert np.isnan(aids.position.x[:, 2]).all()
    assert aids.position.sigma is not None
    assert aids.position.sigma[:, 0].tolist() == [1.5] * 3
    assert aids.velocity is not None
    assert aids.velocity.t.tolist() == [1.0, 1.5, 2.0, 3.0]
    assert aids.velocity.x[:, 0].tolist() == [1.0, 4.0, 2.0, 5.0]
    assert aids.velocity.sigma is not None
    assert np.array_equal(aids.velocity.sigma, [0.2, nan, 0.3, 0.6], equal_nan=True)


def test_heights_and_airspeeds_are_taken_in_their_units() -> None:
    pressure = Stream(np.arange(3.0), np.full((3, 1), 1e5), "Pa", "", "BARO")
    height = Stream(np.arange(3.0), np.array([[1.0], [nan], [3.0]]), "m", "", "BARO:1")
    speed = Stream(np.arange(2.0), np.array([[9.0], [np.inf]]), "m/s", "", "ARSP")
    aids = inputs.aids_of(flight(baro=[pressure, height], airspeed=speed), REST)
    assert aids.baro is not None
    assert aids.airspeed is not None
    assert (aids.baro.t.tolist(), aids.baro.x.tolist()) == ([0.0, 2.0], [1.0, 3.0])
    assert aids.airspeed.x.tolist() == [9.0]
    assert aids.at_rest is not None
    assert aids.at_rest.tolist() == [[0.0, 30.0], [40.0, 45.0]]


def test_a_log_without_any_has_no_aids() -> None:
    aids = inputs.aids_of(flight(), Segments([]))
    assert (aids.position, aids.velocity, aids.baro, aids.airspeed) == (None, None, None, None)
    assert aids.at_rest is not None
    assert aids.at_rest.shape == (0, 2)


@pytest.mark.parametrize("name", ["px4_steps.ulg", "copter_yaw_turns.bin", "copter_steps_stabilize.tlog"])
def test_the_logs_of_all_firmwares_have_their_aids(name: str) -> None:
    """A simulated copter: it begins where it rests, and what GNSS says of the climb the barometer says too."""
    log = attlog.read(SAMPLES / name)
    aids = inputs.aids_of(log, segments.build(log))
    assert aids.position is not None
    assert aids.velocity is not None
    assert aids.baro is not None
    assert aids.at_rest is not None
    climb = np.ptp(aids.position.x[:, 2]), np.ptp(aids.baro.x)
    assert climb[0] == pytest.approx(climb[1], abs=2.5)
    assert climb[0] > 5.0
    resting = aids.resting(aids.velocity.t) == 1
    assert np.count_nonzero(resting) > 20
    assert np.abs(aids.velocity.x[resting, :2]).max() < 0.3 < np.abs(aids.velocity.x[~resting, :2]).max()


PLUGIN = '''"""Counts the fixes it is handed; its gain is a parameter of the log."""
import numpy as np
from attlog.estimators import Parameter
from attlog.estimators.aids import VEL_N
from attlog.estimators.vectors import field_error, gravity_error, turn
from tests.flight.made_log import with_fields
SOURCE = "test"
USES = {"mag", "gnss"}
STATE = {"q": 4, "bias": 3, "_none": 1}
PARAMETERS = (Parameter("kp", 0.5, "1/s", 0, 10, "gain", "test"),)

def from_log(params, info):
    return {"kp": params["AHRS_RP_P"]} if "AHRS_RP_P" in params else {}

def start(params, acc, mag, q0):
    state = np.zeros(8)
    state[0:4] = q0
    return state

def step(state, params, dt, gyr, acc, mag, aid):
    if aid[VEL_N] == aid[VEL_N]:
        state[4] += 1e-6
    x, y, z = gravity_error(state, acc, 1.0)
    a, b, c = field_error(state, mag, 0.0)
    turn(state, gyr[0] + params[0] * (x + a), gyr[1] + params[0] * (y + b), gyr[2] + params[0] * (z + c), dt, 0.0)
'''


@pytest.mark.slow
def test_an_analysis_gives_a_plug_in_the_aids_and_parameters_of_the_log(tmp_path: Path) -> None:
    from attlog.pipeline import prepare
    from attlog.pipeline.replay import run_rows

    file = tmp_path / "mine.py"
    file.write_text(PLUGIN)
    path = SAMPLES / "copter_yaw_turns.bin"
    result = attlog.analyze(path, {"estimators": [str(file)]})
    row = next(r for r in result.estimators if r.name == "mine")
    assert row.status == "ok"
    log = attlog.read(path)
    assert (row.parameters["kp"].value, row.parameters["kp"].origin) == (log.param("AHRS_RP_P"), "log")
    assert row.parameters["declination"].origin == "log"
    rerun = run_rows(prepare(log, {"gyro_bias": "none"}), [str(file)])[0]
    fixes = np.count_nonzero((log.gnss[0].fix >= 3) & (log.gnss[0].t > rerun.t[0]) & (log.gnss[0].t <= rerun.t[-1]))
    assert rerun.bias is not None
    assert rerun.bias[-1, 0] == pytest.approx(1e-6 * fixes)


def test_aids_tell_the_earths_field_and_the_lag_of_the_units_filters() -> None:
    """A field of 50 uT that dips by 60 deg, 30 deg east of north; a low-pass at 20 Hz is late by 11.25 ms."""
    unit = imu(50.0)
    unit.gyro.delay, unit.acc.delay = np.sqrt(2.0) / (2.0 * np.pi * 20.0), 1e9
    aids = inputs.aids_of(flight(imus=[unit]), REST, unit, earth.MagneticField(30.0, 60.0, 50e-6, "by hand"))
    assert aids.field == pytest.approx([25e-6 * np.sqrt(0.75), 12.5e-6, 50e-6 * np.sqrt(0.75)])
    assert aids.lag[0] == pytest.approx(0.01125, abs=1e-5)
    assert aids.lag[1] < 0.1
    assert aids.between(1.0, 2.0).lag == aids.lag


def test_an_impact_is_told_to_whole_runs() -> None:
    crashed = Segments([*REST.segments, Segment("impact", 33.0, 60.0)])
    assert inputs.aids_of(flight(), crashed).impact == 33.0
    assert inputs.aids_of(flight(), REST).impact is None


@pytest.mark.parametrize("wrong", ["baro", "position", "velocity"])
def test_an_aid_that_contradicts_the_others_is_left_out_and_not_the_smoother(
    monkeypatch: pytest.MonkeyPatch, wrong: str
) -> None:
    """The smoother gives way seven times where the wrong aid is used; without GNSS velocity it cannot do."""
    t = np.arange(0.0, 60.0, 0.2)
    one, three = Measurements(t, np.zeros(len(t)), None), Measurements(t, np.zeros((len(t), 3)), None)
    given = Aids(baro=one, position=three, velocity=three)
    monkeypatch.setattr(replay.inputs, "aids_of", lambda *_: given)
    monkeypatch.setattr(replay.inputs, "facts_of", lambda *_: None)

    def smooth(name: str, at: np.ndarray, *_: object, aids: Aids, **__: object) -> Estimate:
        used = " ".join(x for x in ("baro", "position", "velocity") if getattr(aids, x) is not None)
        sigma = np.full(len(at), 1e-3)
        quality: dict[str, float | str] = {"aided_by": used, "openings": 7.0 if wrong in used.split() else 0.0}
        aux = {"sigma_tilt": sigma, "sigma_heading": sigma}
        return Estimate(at, np.tile([1.0, 0.0, 0.0, 0.0], (len(at), 1)), aux=aux, quality=quality)

    monkeypatch.setattr(replay.estimators, "estimate", smooth)
    log = flown_log(60.0)
    if wrong == "velocity":
        with pytest.raises(UsageError, match="gave way 7 times"):
            replay.smoother(log, segments.build(log), ReferenceOptions())
    else:
        found = replay.smoother(log, segments.build(log), ReferenceOptions())
        assert wrong not in str(found.quality["aided_by"]).split()
