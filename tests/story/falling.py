"""A quadrotor in closed loop whose motors can fail: rates, tilt and outputs for the rules of motors.

Roll and pitch are integrated at 400 Hz: each motor lifts in proportion to its output and turns the body about the arm
on which it stands. The controller asks for level, and its outputs are clipped at floor and ceiling.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.flight.drive import QUAD_X, MotorOutputs, frame_of
from attlog.flight.model import Attitude, Firmware, FlightLog, Imu, Stream
from attlog.segments.impacts import CrashEvent
from attlog.segments.model import Segment, Segments

Array = NDArray[np.float64]

STEP_HZ = 400
# Where the propellers of a quad X lift, right and front positive: motors 1 to 4 are front right, rear left, front left,
# rear right; and the sense in which they turn, counter-clockwise from above positive.
RIGHT, FRONT = np.array([1.0, -1.0, -1.0, 1.0]), np.array([1.0, -1.0, 1.0, -1.0])
COUNTER_CLOCKWISE = np.array([1.0, 1.0, -1.0, -1.0])
# Angular acceleration in deg/s^2 by a difference of 1 between the sides, as of a quadrotor of 1.5 kg, and of yaw.
AUTHORITY_DPS2, YAW_DPS2 = 6000.0, 300.0
# Lag of the motors in s; gains of attitude (1/s) and rate (output for a deg/s); fastest wanted rate in deg/s.
LAG_S, ATTITUDE_GAIN, RATE_GAIN, YAW_GAIN, FASTEST_DPS = 0.05, 4.0, 0.0015, 0.002, 120.0


@dataclass
class Fall:
    """A flight of ``seconds`` in which ``motor`` (index) loses the share ``lost`` of its thrust at ``at`` s."""

    motor: int = 0
    at: float = 10.0
    lost: float = 1.0
    seconds: float = 12.0
    hz: float = 10.0
    wanted_deg: float = 0.0

    def flown(self) -> tuple[FlightLog, Segments]:
        """The log and its segments; it is over where it passes 90 deg."""
        n = int(self.seconds * STEP_HZ)
        t = np.arange(n) / STEP_HZ
        rate, angle, outputs = np.zeros((n, 3)), np.zeros((n, 2)), np.zeros((n, 4))
        noise = np.random.default_rng(1).normal(0.0, 0.01, (n, 4))
        now, tilt, thrust = np.zeros(3), np.zeros(2), np.full(4, 0.5)
        for k in range(n):
            want = self.wanted_deg * np.sign(np.sin(2.0 * np.pi * 0.25 * t[k]))
            asked = np.clip(ATTITUDE_GAIN * (want - tilt), -FASTEST_DPS, FASTEST_DPS)
            push = RATE_GAIN * (asked - now[:2])  # roll right and nose up positive
            x = np.clip(
                0.5 - RIGHT * push[0] + FRONT * push[1] - YAW_GAIN * COUNTER_CLOCKWISE * now[2] + noise[k], 0.0, 1.0
            )
            thrust += (x - thrust) / (LAG_S * STEP_HZ)
            lift = thrust * np.where((np.arange(4) == self.motor) & (t[k] >= self.at), 1.0 - self.lost, 1.0)
            turn = [-np.mean(RIGHT * lift), np.mean(FRONT * lift)]
            yaw = YAW_DPS2 * np.mean(COUNTER_CLOCKWISE * lift)  # the body turns against the propellers: to the right
            now = now + np.array([*(AUTHORITY_DPS2 * np.array(turn)), yaw]) / STEP_HZ
            tilt = tilt + now[:2] / STEP_HZ
            rate[k], angle[k], outputs[k] = now, tilt, x
        over = np.flatnonzero(np.hypot(*angle.T) > 90.0)
        end = float(t[over[0]]) if len(over) else float(t[-1])
        return flight_log(t, rate, angle, outputs, round(STEP_HZ / self.hz)), segments(end, bool(len(over)))


def flight_log(t: Array, rate: Array, angle: Array, outputs: Array, every: int) -> FlightLog:
    """The log of a quadrotor X by rates (n, 3) deg/s, roll and pitch (n, 2) deg and outputs, every so many logged."""
    log = FlightLog(Path("made"), "made", 0, 0, Firmware("made"), "quadrotor")
    gyro = Stream(t, np.radians(rate), "rad/s", "FRD", "gyro")
    log.imus, log.imu = [Imu(0, gyro, Stream(t, np.zeros_like(rate), "m/s^2", "FRD", "acc"))], 0
    q = rotation.from_euler(*np.radians(angle).T, 0.0 * t)
    log.attitudes, log.onboard = {"ATT": Attitude(t, q, "ATT")}, "ATT"
    log.baro = [Stream(t[::40], 10.0 + 0.01 * np.sin(t[::40, None]), "m", "", "BARO")]  # a constant one is stuck
    names = ["C1", "C2", "C3", "C4"]
    log.power.outputs = MotorOutputs(
        t[::every], outputs[::every], "RCOU", names, geometry=frame_of(QUAD_X, "FRAME_TYPE 1")
    )
    return log


def level_log(seconds: float, outputs: Array) -> FlightLog:
    """A quadrotor X that stays level at constant outputs (4,)."""
    t = np.arange(0.0, seconds, 0.02)
    none = np.zeros((len(t), 3))
    return flight_log(t, none, none[:, :2], np.tile(outputs, (len(t), 1)), 5)


def segments(end: float, crashed: bool = False, blow: float | None = None) -> Segments:
    """A flight from 1 s to its end, with an overturn there, or a blow."""
    made = Segments([Segment("continuous", 0.0, end + 2.0), Segment("airborne", 1.0, end)])
    if crashed:
        made.crash_events = [CrashEvent("overturn", end, end + 0.5, 120.0, "deg", "over")]
    if blow is not None:
        made.crash_events.append(CrashEvent("impact", blow, blow, 8.0, "g", "blow"))
    return made
