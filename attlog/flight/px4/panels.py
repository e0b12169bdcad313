"""Signals of PX4's logs in the figures of flight data, from 1.5 to 1.17.

Topics and fields were renamed several times; the first logged row of a label counts.
"""

from __future__ import annotations

from attlog.flight.panels import PanelRows, Row

LOCAL, DEMAND = "vehicle_local_position", "vehicle_local_position_setpoint"

ROWS: PanelRows = {
    "height": (
        Row("set-point", f"{DEMAND}.z", -1.0),
        Row("set-point", "trajectory_setpoint.position[2]", -1.0),
        Row("TECS set-point", "tecs_status.altitude_sp"),
    ),
    "climb": (
        Row("onboard", f"{LOCAL}.vz", -1.0),
        Row("set-point", f"{DEMAND}.vz", -1.0),
        Row("set-point", "trajectory_setpoint.velocity[2]", -1.0),
        Row("set-point", "tecs_status.height_rate_setpoint"),
    ),
    "speed": (
        Row("set-point", (f"{DEMAND}.vx", f"{DEMAND}.vy")),
        Row("set-point", ("trajectory_setpoint.velocity[0]", "trajectory_setpoint.velocity[1]")),
        Row("set-point", "rover_velocity_status.adjusted_speed_body_x_setpoint"),
        Row("air set-point", "tecs_status.equivalent_airspeed_sp"),
        Row("air set-point", "tecs_status.true_airspeed_sp"),
    ),
    "motors": (Row("motor {}", "actuator_motors.control[{}]", 100.0),),
    "servos": (Row("servo {}", "actuator_servos.control[{}]", 100.0),),
    "outputs": (Row("output {}", "actuator_outputs.output[{}]"),),
    "rpm": (Row("rotor {}", "esc_status.esc[{}].esc_rpm"),),
    "esc_current": (Row("ESC {}", "esc_status.esc[{}].esc_current"),),
    "sticks": (
        Row("roll", "manual_control_setpoint.roll", 100.0),
        Row("pitch", "manual_control_setpoint.pitch", 100.0),
        Row("throttle", "manual_control_setpoint.throttle", 100.0),
        Row("yaw", "manual_control_setpoint.yaw", 100.0),
        Row("roll", "manual_control_setpoint.y", 100.0),
        Row("pitch", "manual_control_setpoint.x", 100.0),
        Row("throttle", "manual_control_setpoint.z", 100.0),
        Row("yaw", "manual_control_setpoint.r", 100.0),
    ),
    "channels": tuple(Row(f"channel {k}", f"input_rc.values[{k - 1}]") for k in range(5, 13)),
    "volts": (Row("battery", "battery_status.voltage_v"),),
    "amperes": (Row("battery", "battery_status.current_a"),),
    "used": (Row("battery", "battery_status.discharged_mah"),),
    "remaining": (Row("battery", "battery_status.remaining", 100.0),),
    "rails": (
        Row("board", "system_power.voltage5V_v"),
        Row("payload rail", "system_power.voltage_payload_v"),
        Row("sensors, 3.3 V", "system_power.sensors3v3[0]"),
        Row("sensors, 3.3 V", "system_power.voltage3v3_v"),
        Row("sensors, 3.3 V", "system_power.voltage3V3_v"),
    ),
    "dilution": (Row("vertical", "vehicle_gps_position.vdop"), Row("vertical", "sensor_gps.vdop")),
    "load": (Row("CPU", "cpuload.load", 100.0), Row("memory", "cpuload.ram_usage", 100.0)),
    "dropouts": (Row("logger", "logger_status.dropouts"),),
    "link": (Row("receiver signal", "input_rc.rssi"), Row("receiver link quality", "input_rc.link_quality")),
    "temperature": (
        Row("IMU", "vehicle_imu_status.temperature_accel"),
        Row("barometer", "sensor_baro.temperature"),
        Row("barometer", "vehicle_air_data.baro_temp_celcius"),
        Row("battery", "battery_status.temperature"),
        Row("ESC {}", "esc_status.esc[{}].esc_temperature"),
    ),
}
