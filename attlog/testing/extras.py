"""Checks of what a filter takes beside its samples: aids, and parameters from a log."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

import numpy as np

from attlog.base.errors import AttlogError
from attlog.estimators import Aids, Estimate, LogFacts, LogInfo, Measurements
from attlog.testing.motion import CONSUMER, Motion, swing
from attlog.testing.subject import IN_PLACE, Subject, inclination_deg, require, require_attitudes

INFOS = (
    LogInfo(),
    LogInfo(declination_deg=-12.5, imu_rate_hz=200.0, mag_rate_hz=10.0),
    LogInfo(3.0, 1000.0, 80.0, gyro_noise=1e-4, acc_noise=2e-3, rest_s=30.0),
)
"""What logs may tell: nothing, no rest, everything."""


def aids_in_place(m: Motion, seed: int = 0) -> Aids:
    """What receivers and sensors show with noise in a motion that turns and does not move, each at its own rate."""
    random = np.random.default_rng(seed)

    def clock(rate: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return np.arange(m.t[0] + 0.003, m.t[-1], 1.0 / rate)

    fixes, heights, speeds = clock(5.0), clock(20.0), clock(10.0)
    place = np.array([60.0, 10.0, 100.0]) + random.standard_normal((len(fixes), 3)) * [1e-5, 2e-5, 2.0]
    return Aids(
        position=Measurements(fixes, place, np.tile([1.0, 2.0], (len(fixes), 1))),
        velocity=Measurements(fixes, 0.1 * random.standard_normal((len(fixes), 3)), np.full(len(fixes), 0.1)),
        baro=Measurements(heights, 100.0 + 0.2 * random.standard_normal(len(heights))),
        airspeed=Measurements(speeds, np.abs(0.3 * random.standard_normal(len(speeds)))),
        at_rest=np.empty((0, 2)),
    )


def works_with_aids(s: Subject) -> None:
    """With GNSS, barometer and airspeed of a vehicle that stays in place tilt is as good as without."""
    m = swing(60.0, noise=CONSUMER)
    plain, aided = s.run(m), s.run(m, aids=aids_in_place(m))
    require_attitudes(aided, m.t)
    if s.uses_acc:
        off = [np.sqrt(np.mean(inclination_deg(e.q[-2000:], m.q[-2000:]) ** 2)) for e in (plain, aided)]
        require(off[1] < off[0] + 1.0, f"with aids tilt is off by {off[1]:.1f} deg, without by {off[0]:.1f} deg")


def survives_few_aids(s: Subject) -> None:
    """Each aid alone, aids that end, and none in the time of the samples: finite attitudes all the same."""
    m = swing(20.0)
    full = aids_in_place(m)
    cases: dict[str, Aids] = {f"{n} alone": Aids(**{n: getattr(full, n)}) for n in ("position", "velocity", "baro")}
    cases |= {"airspeed alone": Aids(airspeed=full.airspeed), "rest alone": Aids(at_rest=np.array([[2.0, 4.0]]))}
    cases |= {"aids that end": full.between(0.0, 5.0), "aids of another time": full.between(-2.0, -1.0)}
    for what, aids in cases.items():
        if s.needs_gnss and aids.velocity is None:
            aids = replace(aids, velocity=IN_PLACE.velocity)
        e: Estimate = s.run(m, aids=aids)
        require_attitudes(e, m.t)
        worst = inclination_deg(e.q[-500:], m.q[-500:]).max() if s.uses_acc else 0.0
        require(worst < 5.0, f"with {what} tilt is off by {worst:.1f} deg")


def takes_aids_when_they_come(s: Subject) -> None:
    """Aids of later do not change what was said before."""
    m = swing(20.0)
    aids = aids_in_place(m)
    half = len(m.t) // 2
    q = [s.run(m, aids=a).q[:half] for a in (aids, aids.between(0.0, float(m.t[half])))]
    require(np.array_equal(q[0], q[1]), "later aids change earlier attitudes")


def takes_parameters_from_a_log(s: Subject) -> None:
    """``from_log`` gives known parameters within their ranges for any log, changes nothing and repeats itself."""
    names = {p.name for p in s.estimator.parameters}
    known: dict[str, float] = {}
    for info in INFOS:
        try:
            first = s.estimator.values_of(LogFacts(MappingProxyType(known), info), names)
            second = s.estimator.values_of(LogFacts(MappingProxyType(known), info), names)
        except AttlogError as error:
            require(False, f"from_log fails on a log without parameters, of which is known {info}: {error}")
            return
        require(first == second, f"from_log says {first} and then {second} of the same log")
