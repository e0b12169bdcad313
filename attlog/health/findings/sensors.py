"""Gyro, accelerometer, vibration, GNSS, and how they were recorded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from attlog.flight.remedies import Fault
from attlog.health.findings.attitude import ESTIMATOR
from attlog.health.findings.finding import Explanation, Finding
from attlog.health.sensors.accelerometer import MEAN_GRAVITY

VIBRATION, GNSS, ACCELEROMETER, RATE = "vibration", "gnss", "accelerometer", "rate"
_STOPPED = "The sensor, its driver or its bus stopped."
CHECKS = {
    "gyro": Explanation("gyro", as_fault="serious", cause=_STOPPED),
    "gravity": Explanation(
        ACCELEROMETER,
        cause="The accelerometer is not calibrated, has the wrong range set, or vibrates.",
        fault="accelerometer",
    ),
    "frozen gyro": Explanation("frozen_gyro", as_fault="serious", cause=_STOPPED, fault="bus"),
    "gyro spikes": Explanation(
        "gyro_spikes",
        as_fault="serious",
        cause="Errors on the sensor's bus, or samples that leave its range.",
        fault="bus",
    ),
    "accelerometer axes": Explanation(
        "accelerometer_axes",
        as_fault="serious",
        cause="The accelerometer is mounted otherwise than set, or its axes are mixed up.",
        fault="mounting",
    ),
    "accelerometer delay": Explanation(
        "accelerometer_delay",
        as_fault="serious",
        cause="Its samples wait in a queue, or are stamped by another clock.",
        fault="bus",
    ),
    "frozen sensors": Explanation("frozen_sensors", as_fault="serious", cause=_STOPPED, fault="bus"),
    "gyro bias": Explanation(
        "gyro_bias",
        as_fault="serious",
        cause="The gyro was not calibrated, was moved while it started, or warms up.",
        fault="gyro_bias",
    ),
    "vertical force": Explanation(
        VIBRATION,
        as_fault="serious",
        cause="Vibration that clips or is rectified in the sensor becomes a constant force.",
        fault="vibration",
    ),
    "vibration": Explanation(
        VIBRATION,
        cause="Unbalanced or damaged propellers, play in a bearing or arm, or a stiff mounting.",
        fault="vibration",
    ),
    "accelerometer bias": Explanation(
        ACCELEROMETER,
        cause="The accelerometer is off, was calibrated on a slope, or the estimator has learned wrongly.",
        fault="accelerometer",
    ),
    "gravity in flight": Explanation(
        ACCELEROMETER,
        cause="Wrong scale, vibration that the sensor rectifies or clips, or a wrong attitude.",
        fault="accelerometer",
    ),
    "gyro range": Explanation("gyro_range", cause="A blow or vibration beyond the sensor's range."),
    "GNSS": Explanation(GNSS, cause="Bad view of the sky, interference, or a receiver that failed.", fault="gnss"),
    "imu delay": Explanation(
        "imu_delay",
        as_fault="serious",
        cause="Samples are stamped when published, wait in a queue, or pass a filter that no parameter shows.",
        fault="clock",
    ),
    "gyro scale": Explanation(
        "gyro_scale",
        as_fault="serious",
        cause="The gyro's own scale or its range setting; no calibration corrects it.",
        fault="gyro_scale",
    ),
    "gyro bias step": Explanation(
        "gyro_bias", cause="The gyro warmed up or was struck, or its driver lost its calibration.", fault="gyro_scale"
    ),
    "force axes": Explanation(
        "accelerometer_axes",
        as_fault="serious",
        cause="The accelerometer is mounted otherwise than set, or its axes are mixed up.",
        fault="mounting",
    ),
    "force offset": Explanation(
        ACCELEROMETER,
        cause="The accelerometer was not calibrated, or on a slope or at another temperature.",
        fault="accelerometer",
    ),
    "gaps": Explanation("gaps", cause="The logger lost records: card or link are too slow.", fault="gaps"),
    "jitter": Explanation("jitter", as_warning="note", as_fault="note", cause="The logger was busy.", fault="gaps"),
    "rate": Explanation("rate", as_warning="note", as_fault="serious"),
    "delay": Explanation("delay", as_warning="note", cause="Low-pass filters ahead of the logger, or another clock."),
}
REPORTS = {
    "vibration_failsafe": VIBRATION,
    "gyro_clipped": "gyro_range",
    "gnss_glitch": GNSS,
    "err_7_1": GNSS,
    "err_31_1": GNSS,
    "ev_19": GNSS,
    "logger_dropouts": "gaps",
    "imu_low_rate": RATE,
    "imu_rate_too_low": RATE,
    "no_imu": RATE,
    "imu_too_short": RATE,
}
"""What readers and autopilot say of them, by code."""
SHAKEN = ("imu_switched", "sensor_switch", "attitude", ESTIMATOR)
"""Kinds that vibration explains where they begin with it."""
STOPPED = "The logger stopped and went on later: no card loses seconds."
BEFORE_S = 1.0


def shaken(sign: Finding, remedies: Mapping[Fault, str]) -> Finding:
    """A sign with the cause and the action of strong vibration where it is an event of that."""
    if sign.about != "vibration":
        return sign
    return replace(sign, cause=CHECKS["vibration"].cause, action=remedies.get("vibration", ""))


def settled(signs: Sequence[Finding]) -> list[Finding]:
    """The signs with what vibration explains under it: a force that is off, switches and rejections from then on."""
    signs = [replace(s, cause=STOPPED, action="") if s.about == "stopped" else s for s in signs]
    shaken = [s for s in signs if s.kind == VIBRATION and s.is_trouble and s.about != "vertical force"]
    if not shaken:
        return list(signs)
    strong = any(s.about == "clipping" or s.severity == "serious" for s in shaken)
    onset = min((s.t for s in shaken if s.t is not None), default=None)
    signs = [_explained(sign, onset, strong) for sign in signs]
    own = {"clipping": 0, "vertical force": 1, "vibration": 1, "vibration_level": 1}
    return sorted(signs, key=lambda sign: own.get(sign.about, 2))


def _explained(sign: Finding, onset: float | None, strong: bool) -> Finding:
    begins_with_it = sign.t is not None and onset is not None and sign.t >= onset - BEFORE_S
    if sign.severity == "serious":
        return sign
    if sign.about in ("gravity in flight", MEAN_GRAVITY) or (strong and sign.kind in SHAKEN and begins_with_it):
        return replace(sign, kind=VIBRATION, cause="", action="")
    return sign
