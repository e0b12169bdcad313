"""Motor geometry against physics, and outputs of both firmwares against their parameters."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight import drive
from attlog.flight.ardupilot import drive as ardupilot
from attlog.flight.ardupilot.imu import DataflashBuilder
from attlog.flight.drive import ARDUPILOT_FRAMES, frame_of, position_name
from attlog.flight.px4 import drive as px4
from attlog.flight.px4.imu import TopicBuilder
from attlog.formats.table import ParamChange
from tests.flight import fake

QUAD = {"FRAME_CLASS": 1.0, "FRAME_TYPE": 1.0}


@pytest.mark.parametrize("row", sorted({*ARDUPILOT_FRAMES.values(), *drive.PX4_FRAMES.values()}))
def test_a_frame_balances_and_every_motor_has_an_opposite(row: str) -> None:
    made = frame_of(row, "")
    assert np.abs(made.lever.sum(axis=0)).max() < 1e-12
    assert made.spin.sum() == 0
    for motor in range(len(made.bearing)):
        other = made.opposite(motor)
        assert other is not None
        assert np.allclose(made.lever[other], -made.lever[motor])
    assert np.abs(made.lever.T @ made.spin).max() < 1e-12  # roll and pitch do not yaw


def test_the_first_motor_of_a_quad_x_rolls_left_and_lifts_the_nose() -> None:
    roll, pitch = frame_of(drive.QUAD_X, "").lever[0]
    assert roll < 0 < pitch


@pytest.mark.parametrize(
    ("bearing", "name"),
    [
        (0, "front"),
        (30, "front right"),
        (90, "right"),
        (150, "rear right"),
        (180, "rear"),
        (-135, "rear left"),
        (270, "left"),
    ],
)
def test_positions_have_names(bearing: float, name: str) -> None:
    assert position_name(bearing) == name


def test_px4s_rotors_give_bearing_and_spin() -> None:
    values = {"CA_ROTOR_COUNT": 4.0}
    for k, (x, y, km) in enumerate([(1, 1, 0.05), (-1, -1, 0.05), (1, -1, -0.05), (-1, 1, -0.05)]):
        values |= {f"CA_ROTOR{k}_PX": 0.15 * x, f"CA_ROTOR{k}_PY": 0.15 * y, f"CA_ROTOR{k}_KM": km}
    found, quad = drive.px4_geometry(values, 4), frame_of(drive.QUAD_X, "")
    assert found is not None
    assert np.allclose(found.bearing, quad.bearing)
    assert (found.spin == quad.spin).all()


@pytest.mark.parametrize(
    ("values", "count"),
    [({"FRAME_CLASS": 5.0, "FRAME_TYPE": 1.0}, 6), (QUAD, 6), ({"FRAME_CLASS": 1.0}, 4), ({}, 4), ({"FRAME": 1.0}, 6)],
)
def test_an_unknown_frame_has_no_geometry(values: dict[str, float], count: int) -> None:
    assert drive.ardupilot_geometry(values, count) is None


@pytest.mark.parametrize(
    ("frame", "count", "row"),
    [("", 4, drive.QUAD_X), ("HEXA", 6, drive.HEXA_X), ("Y6", 6, ""), ("OCTA_QUAD", 8, drive.OCTO_QUAD_X)],
)
def test_before_frame_class_the_firmwares_text_names_the_frame(frame: str, count: int, row: str) -> None:
    found = drive.ardupilot_geometry({"FRAME": 1.0}, count, frame=frame)
    assert (found is not None) is bool(row)
    assert found is None or np.array_equal(found.bearing, frame_of(row, "").bearing)


@pytest.mark.parametrize("values", [{"SYS_AUTOSTART": 4040.0}, {"SYS_AUTOSTART": 1001.0}, {}])
def test_px4s_other_airframes_have_no_geometry(values: dict[str, float]) -> None:
    assert drive.px4_geometry(values, 4) is None
    assert drive.px4_geometry({"SYS_AUTOSTART": 4001.0}, 4) is not None


def logged(params: dict[str, float], pulses: np.ndarray, prefix: str = "C") -> DataflashBuilder:
    """RCOU at 10 Hz of a quadrotor."""
    columns = {"TimeUS": fake.micros(len(pulses), 10.0)}
    columns |= {f"{prefix}{k + 1}": pulses[:, k].astype(np.uint16) for k in range(pulses.shape[1])}
    builder = DataflashBuilder(fake.messages("dataflash", {("RCOU", 0): columns}, params))
    builder.log.vehicle = "quadrotor"
    return builder


PULSES = np.tile(np.array([1000.0, 1150.0, 1950.0, 2000.0]), (20, 1))
SPIN = {"MOT_SPIN_MIN": 0.15, "MOT_SPIN_MAX": 0.95}


@pytest.mark.parametrize(
    ("params", "wanted"),
    [
        (SPIN | {"MOT_PWM_MIN": 1000.0, "MOT_PWM_MAX": 2000.0}, (-0.1875, 0.0, 1.0, 1.0625)),
        (SPIN | {"MOT_PWM_MIN": 0.0, "RC3_MIN": 1000.0, "RC3_MAX": 2000.0}, (-0.1875, 0.0, 1.0, 1.0625)),
        (SPIN | {"MOT_PWM_TYPE": 6.0, "MOT_PWM_MIN": 1100.0, "MOT_PWM_MAX": 1900.0}, (-0.1875, 0.0, 1.0, 1.0625)),
        ({"THR_MIN": 150.0, "RC3_MIN": 1000.0, "RC3_MAX": 2000.0}, (-0.17647, 0.0, 0.94118, 1.0)),
        ({"THR_MIN": 150.0, "MOT_THST_EXPO": 0.5, "RC3_MIN": 1000.0, "RC3_MAX": 2000.0}, (-0.1875, 0.0, 1.0, 1.0625)),
    ],
)
def test_ardupilots_outputs_run_from_floor_to_ceiling(params: dict[str, float], wanted: tuple[float, ...]) -> None:
    found = ardupilot.motor_outputs(logged(QUAD | params, PULSES))
    assert found is not None
    assert found.scaled
    assert found.x[0] == pytest.approx(wanted, abs=1e-5)


def test_outputs_without_limits_are_not_scaled() -> None:
    found = ardupilot.motor_outputs(logged(QUAD, PULSES))
    assert found is not None
    assert not found.scaled
    assert found.x[0] == pytest.approx((0.0, 0.15, 0.95, 1.0))


def test_the_output_that_holds_a_motor_at_boot_is_that_motor() -> None:
    pulses = np.column_stack([PULSES, PULSES[:, :1] + 77.0])
    functions = {f"SERVO{n}_FUNCTION": float(32 + m) for m, n in ((1, 5), (2, 2), (3, 3), (4, 4))}
    builder = logged(QUAD | SPIN | {"MOT_PWM_MIN": 1000.0, "MOT_PWM_MAX": 2000.0} | functions, pulses)
    later = ParamChange("SERVO3_FUNCTION", 0.0, 11_000_000)
    builder.messages.params.append(later)
    builder.log.parameters.lines = ardupilot_lines(builder)
    found = ardupilot.motor_outputs(builder)
    assert found is not None
    assert found.names == ["C5", "C2", "C3", "C4"]
    assert [sentence.split(" at ")[0] for _, sentence in found.changes] == [
        "SERVO3_FUNCTION of motor 3 changed from 35 to 0"
    ]


def ardupilot_lines(builder: DataflashBuilder) -> dict:  # type: ignore[type-arg]
    from attlog.flight.parameters import parameter_lines

    return parameter_lines(builder, "PARM")


def topics(name: str, column: str, x: np.ndarray, params: dict[str, float], instances: int = 1) -> TopicBuilder:
    tables = {
        (name, i): {"timestamp": fake.micros(len(x), 10.0)}
        | {f"{column}[{k}]": (x[:, k] if i == instances - 1 else 0.0 * x[:, k] + 900.0) for k in range(x.shape[1])}
        for i in range(instances)
    }
    builder = TopicBuilder(fake.messages("ulog", tables, params))
    builder.log.vehicle = "quadrotor"
    return builder


def test_px4s_motor_that_is_off_is_nan() -> None:
    x = np.tile(np.array([0.1, np.nan, 0.5, 1.0]), (20, 1))
    found = px4.motor_outputs(topics("actuator_motors", "control", x, {"CA_ROTOR_COUNT": 4.0}))
    assert found is not None
    assert found.x[0] == pytest.approx((0.1, np.nan, 0.5, 1.0), nan_ok=True)


@pytest.mark.parametrize(
    ("params", "sent", "wanted"),
    [
        ({"PWM_MIN": 1100.0, "PWM_MAX": 1900.0}, (1100.0, 1500.0, 1900.0, 1950.0), (0.0, 0.5, 1.0, 1.0625)),
        ({"SYS_AUTOSTART": 4001.0}, (1000.0, 1500.0, 2000.0, 1250.0), (0.0, 0.5, 1.0, 0.25)),
        (  # an output's own limits; its default yields to the group's
            {"PWM_MAIN_MIN": 1075.0, "PWM_MAIN_MIN1": 1000.0, "PWM_MAIN_MIN2": 1100.0, "PWM_MAIN_MAX2": 1900.0},
            (1075.0, 1500.0, 1537.5, 2000.0),
            (0.0, 0.5, 0.5, 1.0),
        ),
        (  # the second instance holds the auxiliary outputs
            {"SYS_USE_IO": 1.0, "PWM_AUX_MIN": 1100.0, "PWM_AUX_MAX": 1900.0, "PWM_MAIN_MIN": 1000.0},
            (1100.0, 1500.0, 1900.0, 1300.0),
            (0.0, 0.5, 1.0, 0.25),
        ),
        ({}, (0.0, 0.5, 1.0, 0.25), (0.0, 0.5, 1.0, 0.25)),
        ({}, (-1.0, 0.0, 1.0, 0.5), (0.0, 0.5, 1.0, 0.75)),
        ({}, (0.0, 8191.0, 4095.5, 819.1), (0.0, 1.0, 0.5, 0.1)),
        (
            {"DSHOT_CONFIG": 600.0, "DSHOT_MIN": 0.0, "PWM_MIN": 1000.0},
            (0.0, 999.5, 1999.0, 199.9),
            (0.0, 0.5, 1.0, 0.1),
        ),
        ({"UAVCAN_ENABLE": 3.0, "PWM_MIN": 1000.0}, (0.0, 2047.75, 819.1, 0.0), (0.0, 0.25, 0.1, 0.0)),
    ],
)
def test_px4s_outputs_are_scaled_by_their_size(
    params: dict[str, float], sent: tuple[float, ...], wanted: tuple[float, ...]
) -> None:
    x = np.tile(np.array(sent), (20, 1))
    x[1::2] *= 0.999  # they vary, those of the other instance do not
    x[1::2] += 1e-3
    found = px4.motor_outputs(topics("actuator_outputs", "output", x, params, instances=2))
    assert found is not None
    assert found.source == "actuator_outputs:1"
    assert found.x[0] == pytest.approx(wanted, abs=1e-6)


def test_px4s_assigned_outputs_have_their_own_limits() -> None:
    functions = {f"PWM_AUX_FUNC{n}": 100.0 + motor for motor, n in ((1, 4), (2, 3), (3, 2), (4, 1))}
    limits = {f"PWM_AUX_MIN{n}": 1000.0 + 10.0 * n for n in (1, 2, 3, 4)} | {
        f"PWM_AUX_MAX{n}": 1900.0 for n in range(9)
    }
    x = np.tile(np.array([1010.0, 1020.0, 1465.0, 1900.0]), (20, 1)) + 1e-3 * np.arange(20)[:, None]
    params = {"CA_ROTOR_COUNT": 4.0} | functions | limits
    found = px4.motor_outputs(topics("actuator_outputs", "output", x, params))
    assert found is not None
    assert found.names == ["output[3]", "output[2]", "output[1]", "output[0]"]
    assert found.x[0] == pytest.approx((1.0, 0.5, 0.0, 0.0), abs=1e-6)


def test_px4s_motors_on_two_groups_of_outputs_are_not_guessed() -> None:
    functions = {"PWM_MAIN_FUNC1": 101.0, "PWM_MAIN_FUNC2": 102.0, "PWM_AUX_FUNC1": 103.0, "PWM_AUX_FUNC2": 104.0}
    x = 1500.0 + np.arange(20)[:, None] * np.ones(4)
    assert px4.motor_outputs(topics("actuator_outputs", "output", x, {"CA_ROTOR_COUNT": 4.0} | functions)) is None


def test_speed_controllers_carry_the_motor_that_px4_logs() -> None:
    columns = {"timestamp": fake.micros(20, 10.0)}
    for k, motor in enumerate((102, 101)):
        values = {"esc_rpm": 5000.0 + k, "esc_current": 2.0 * k, "esc_temperature": 300.0, "actuator_function": motor}
        columns |= {f"esc[{k}].{name}": np.full(20, x) for name, x in values.items()}
    builder = TopicBuilder(fake.messages("ulog", {("esc_status", 0): columns}, {}))
    first, second = px4.esc_list(builder)
    assert (first.motor, second.motor) == (2, 1)
    assert np.isnan(first.current).all()  # zeros: not measured
    assert second.current[0] == 2.0
    assert first.temperature[0] == pytest.approx(26.85)


def test_a_reversed_motor_in_the_cold_has_a_speed_and_keeps_its_other_signs() -> None:
    x = np.tile([-5000.0, -0.2, -7.0], (20, 1))
    esc = drive.esc_telemetry(0.1 * np.arange(20), x, "ESC[0]")
    assert esc is not None
    assert (esc.rpm[0], esc.current[0], esc.temperature[0]) == (5000.0, -0.2, -7.0)


def test_ardupilots_speed_controllers_have_no_motor_and_a_standing_one_is_none() -> None:
    columns = {"TimeUS": fake.micros(20, 10.0)} | {c: np.full(20, x) for c, x in {"Curr": 3.0, "Temp": 31.0}.items()}
    tables = {("ESC", k): columns | {"RPM": np.full(20, rpm)} for k, rpm in enumerate((4000.0, 0.0, 4100.0))}
    found = ardupilot.esc_list(DataflashBuilder(fake.messages("dataflash", tables, {})))
    assert [(esc.name, esc.motor, esc.rpm[0]) for esc in found] == [("ESC[0]", None, 4000.0), ("ESC[2]", None, 4100.0)]


def test_px4s_reversible_motors_are_not_judged() -> None:
    x = np.tile(np.array([0.1, -0.5, 0.5, 1.0]), (20, 1))
    params = {"CA_ROTOR_COUNT": 4.0, "CA_R_REV": 2.0}
    assert px4.motor_outputs(topics("actuator_motors", "control", x, params)) is None


def test_outputs_of_an_old_tricopter_are_not_guessed() -> None:
    builder = logged({"RC3_MIN": 1000.0, "RC3_MAX": 2000.0}, PULSES)
    builder.log.vehicle = "tricopter"
    assert ardupilot.motor_outputs(builder) is None
