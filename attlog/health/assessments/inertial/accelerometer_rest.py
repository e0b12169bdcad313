"""Does each accelerometer show gravity's size while the vehicle stands still?

At one rest only the size is known: an offset along the vertical and a wrong scale look alike.
"""

from __future__ import annotations

import numpy as np

from attlog.base import rotation
from attlog.flight.model import Imu, Stream
from attlog.health.assessments.inertial.blocks import Blocks, of_stream, still, usable
from attlog.health.assessments.model import Assessment, HealthCase, unknown
from attlog.health.model import graded
from attlog.health.sensors.accelerometer import expected
from attlog.segments.once import asked_once

QUESTION = "accelerometer_rest"
OFF_M_S2, FAR_M_S2 = 0.3, 1.0
"""The first as the check of gravity's size; beyond the second an offset fitted in flight is not exact either."""
SIGMAS, FLOOR_M_S2 = 4.0, 0.01
"""The model of gravity and a level that is not exact."""
LIMIT = f"ok within {OFF_M_S2} m/s^2 or {SIGMAS:.0f} sigma of gravity, fault beyond {FAR_M_S2:.0f}"
SOURCE = "gravity at the place of the flight; 3 % of it tilts nothing but spoils heights"


def answer(case: HealthCase) -> list[Assessment]:
    """One assessment for each accelerometer; one ``unknown`` where the vehicle never stands still."""
    units = usable(case)
    if not units:
        return []
    sizes = {imu.acc.source: size_at_rest(case, imu) for imu in units}
    found = [
        _assessed(case, imu, size) for imu in units if (size := sizes[imu.acc.source]) is not None and _tells(size)
    ]
    why = "The vehicle never stands still on the ground in this log, or shakes too much."
    return found or [unknown(units[0].acc.source, QUESTION, why, LIMIT, SOURCE)]


def _tells(size: Blocks) -> bool:
    """Whether it is known as well as an error of it counts."""
    return 1.96 * float(size.sigma(FLOOR_M_S2)[0]) <= OFF_M_S2


@asked_once
def size_at_rest(case: HealthCase, imu: Imu) -> Blocks | None:
    """Size of the specific force (b, 1) in m/s^2 over blocks of still time on the ground; None without any."""
    spans = [] if case.segments is None else still(case.segments)[0]
    acc = imu.acc
    size = Stream(acc.t, rotation.length(acc.x)[:, None], acc.unit, "", acc.source, t_sample=acc.t_sample)
    return of_stream(size, spans)


def _assessed(case: HealthCase, imu: Imu, found: Blocks) -> Assessment:
    assert case.segments is not None
    where, g = still(case.segments)[1], expected(case.log)
    size, sigma = float(found.middle[0]), float(found.sigma(FLOOR_M_S2)[0])
    error = size - g
    off_from = max(OFF_M_S2, SIGMAS * sigma)
    verdict = graded(abs(error), off_from, max(FAR_M_S2, off_from))
    text = f"{imu.acc.source} shows {size:.2f} ± {1.96 * sigma:.2f} m/s^2 {where}; gravity is {g:.2f}."
    off = verdict != "ok"
    return Assessment(
        imu.acc.source,
        QUESTION,
        verdict,
        text,
        value=round(size, 3),
        unit="m/s^2",
        ci95=(round(size - 1.96 * sigma, 3), round(size + 1.96 * sigma, 3)),
        n=found.samples,
        seconds=round(found.seconds, 1),
        threshold=LIMIT,
        source=SOURCE,
        why_no_setting=_parted(size / g) if off else "",
        action=case.log.remedies.get("accelerometer", "") if off else "",
    )


def _parted(scale: float) -> str:
    also = f"Scale {scale:.3f} or an offset: one position cannot show which." if np.isfinite(scale) else ""
    return f"{also} Log six positions, or a flight with GNSS.".strip()
