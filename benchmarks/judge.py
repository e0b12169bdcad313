"""Sensor faults planted in flights with hidden truth: does the smoother know that it is wrong, and who is accused?

    python benchmarks/judge.py [--corpus DIR] [--simulated] [--others] [--faults NAME,...] [--json FILE] [FLIGHT ...]

Flights are those of ``sitl/`` below the corpus folder (default $ATTLOG_CORPUS), all or those named (part of a file
name); ``--simulated`` adds scenarios of ``attlog simulate``. Each fault of FAULTS, with ``--others`` of
``other_faults.py``, on which no threshold was chosen, is put into a copy of the read log, into every unit of the
sensor. The truth is taken away, the reference is chosen as ``attlog analyze`` does, and the audit is made with it.
Truth then scores both, where they are scored in an analysis. ``-v`` prints each outcome. Columns of the table:

- *kept*: flights with the smoother as reference; *heading*: with its own heading (sigma up to 1 deg).
- *heading beyond 2 sigma*: of those with a heading, how many have an rms of error over sigma above 2; the median and
  the largest of that rms. *Tilt* likewise, of those kept.
- *sound accused*: accusations of an onboard angle whose median error in the accused time is below 3 deg (tilt) or
  8 deg (heading), of all accusations. *named*: flights whose turned onboard angle is accused.

The last lines give the smoother's error over the onboard one's in the air, where nothing was planted.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import time
import zlib
from collections.abc import Iterable, Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import other_faults
from numpy.typing import NDArray
from other_faults import Fault

from attlog import flight, formats, reference, segments
from attlog.core import rotation
from attlog.core.log_cache import log_cache
from attlog.estimators.interface import Estimate
from attlog.flight.model import Attitude, FlightLog, Gnss
from attlog.health import Check, HealthCase, run_checks
from attlog.pipeline import replay
from attlog.reference import alignment, scoring
from attlog.reference.model import Reference, ReferenceOptions
from attlog.segments.model import Segments, interpolate_attitudes

Array = NDArray[np.float64]

SCENARIOS = ("steps", "waypoints", "aggressive", "yaw")
SOUND_DEG = {"tilt": 3.0, "heading": 8.0}
BAD = ("warning", "fault")
ONBOARD = "onboard"
"""Names of faults that leave the sensors alone begin so."""
METRES_PER_DEG = 111_320.0


def gyro_step(axis: int, dps: float, log: FlightLog, middle: float, random: np.random.Generator) -> None:
    for imu in log.imus:
        imu.gyro.x = imu.gyro.x + np.radians(dps) * np.outer(imu.gyro.t_best >= middle, np.eye(3)[axis])


def gyro_bias(log: FlightLog, middle: float, random: np.random.Generator) -> None:
    for imu in log.imus:
        imu.gyro.x = imu.gyro.x + np.radians([1.0, -1.0, 1.0])


def gyro_scale(log: FlightLog, middle: float, random: np.random.Generator) -> None:
    for imu in log.imus:
        imu.gyro.x = imu.gyro.x * 1.03


def force_bias(log: FlightLog, middle: float, random: np.random.Generator) -> None:
    for imu in log.imus:
        imu.acc.x = imu.acc.x + np.array([0.3, 0.0, 0.0])


def field_offset(log: FlightLog, middle: float, random: np.random.Generator) -> None:
    for mag in log.mags:
        mag.field.x = mag.field.x + 1e-7 * np.array([100.0, -60.0, 40.0])


def field_turned(log: FlightLog, middle: float, random: np.random.Generator) -> None:
    for mag in log.mags:
        mag.field.x = rotation.rotate(rotation.from_euler(0.0, 0.0, np.radians(15.0)), mag.field.x)


def field_step(log: FlightLog, middle: float, random: np.random.Generator) -> None:
    for mag in log.mags:
        mag.field.x = mag.field.x + 1e-6 * np.outer(mag.field.t_best >= middle, [10.0, 0.0, 0.0])


def no_compass(log: FlightLog, middle: float, random: np.random.Generator) -> None:
    log.mags, log.mag = [], None


def gnss_lost(log: FlightLog, middle: float, random: np.random.Generator) -> None:
    for gnss in log.gnss:
        gnss.fix = np.where(gnss.t >= middle, 0, gnss.fix)
        for name in ("lat", "lon", "alt", "vel_ned"):
            x = np.array(getattr(gnss, name), np.float64)
            x[gnss.t >= middle] = np.nan
            setattr(gnss, name, x)


def gnss_noisy(log: FlightLog, middle: float, random: np.random.Generator) -> None:
    """Velocity by 0.5 m/s, position by 3 m, white; the receiver does not know."""
    for gnss in log.gnss:
        gnss.vel_ned = gnss.vel_ned + 0.5 * random.standard_normal(gnss.vel_ned.shape)
        north, east, up = 3.0 * random.standard_normal((3, len(gnss.t)))
        gnss.lat = gnss.lat + north / METRES_PER_DEG
        gnss.lon = gnss.lon + east / (METRES_PER_DEG * np.cos(np.radians(np.nanmedian(gnss.lat))))
        gnss.alt = gnss.alt + up


def gnss_late(log: FlightLog, middle: float, random: np.random.Generator) -> None:
    for gnss in log.gnss:
        gnss.t = gnss.t + 0.12


def no_gnss(log: FlightLog, middle: float, random: np.random.Generator) -> None:
    log.gnss = list[Gnss]()


def onboard_turned(deg: float, seconds: float, log: FlightLog, middle: float, random: np.random.Generator) -> None:
    """Every onboard attitude clockwise, around the middle of the flight, there and back within 5 s."""
    for attitude in log.attitudes.values():
        t = attitude.t if attitude.t_sample is None else attitude.t_sample
        share = np.clip((0.5 * seconds + 5.0 - np.abs(t - middle)) / 5.0, 0.0, 1.0)
        attitude.q, attitude.normal = rotation.turn_about_down(attitude.q, np.radians(deg) * share), False


FAULTS: dict[str, Fault] = {
    "nothing": lambda log, middle, random: None,
    "gyro z steps by 2 deg/s": partial(gyro_step, 2, 2.0),
    "gyro z steps by 1 deg/s": partial(gyro_step, 2, 1.0),
    "gyro z steps by 0.5 deg/s": partial(gyro_step, 2, 0.5),
    "gyro x steps by 2 deg/s": partial(gyro_step, 0, 2.0),
    "gyro bias 1 deg/s": gyro_bias,
    "gyro scale 3 %": gyro_scale,
    "accelerometer bias 0.3 m/s^2": force_bias,
    "compass offset 100/-60/40 mG": field_offset,
    "compass turned by 15 deg": field_turned,
    "field steps by 10 uT": field_step,
    "no compass": no_compass,
    "GNSS gone half way": gnss_lost,
    "GNSS noisy": gnss_noisy,
    "GNSS 120 ms late": gnss_late,
    "no GNSS": no_gnss,
    "onboard heading 20 deg off": partial(onboard_turned, 20.0, 1e6),
    "onboard heading 30 deg off for 40 s": partial(onboard_turned, 30.0, 40.0),
}


@dataclass(frozen=True, slots=True)
class Accusation:
    """Who said of which angle of the onboard attitude that it is wrong from when to when (s), and its median error
    there by the truth (deg; None where truth does not cover it)."""

    check: str
    angle: str
    t0: float
    t1: float
    error_deg: float | None
    text: str

    @property
    def false(self) -> bool:
        return self.error_deg is not None and self.error_deg < SOUND_DEG[self.angle]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one fault in one flight; angles in deg, None where there is nothing to score."""

    flight: str
    fault: str
    kind: str
    heading_by: str
    heading_why: str
    tilt_deg: float | None
    heading_deg: float | None
    tilt_sigmas: float | None
    heading_sigmas: float | None
    tilt_ratio: float | None
    heading_ratio: float | None
    accusations: list[Accusation]
    findings: list[str]
    refused: dict[str, str]
    quality: dict[str, float | str]
    cpu_s: float

    @property
    def kept(self) -> bool:
        return self.kind == "smoother"


def errors(t: Array, q: Array, truth: Attitude) -> tuple[Array, Array]:
    """Tilt and signed heading errors (n,) in deg of attitudes (n, 4) at ``t``; NaN where truth does not cover it."""
    at = truth.t if truth.t_sample is None else truth.t_sample
    of, _ = interpolate_attitudes(at, rotation.normalize(truth.q), np.zeros(len(at), np.int64), t)
    e = rotation.earth_error(q, of)
    return np.degrees(rotation.tilt_angle(e)), np.degrees(rotation.heading_angle(e))


def onboard_errors(log: FlightLog, truth: Attitude) -> tuple[Array, Array, Array]:
    """Times (n,) of the onboard attitude, its tilt and signed heading errors in deg; the vehicle's trim put back."""
    attitude = log.onboard_attitude
    assert attitude is not None
    t = attitude.t if attitude.t_sample is None else attitude.t_sample
    q = (
        attitude.q
        if log.parameters.trim is None or not attitude.has_trim
        else alignment.apply_trim(attitude.q, -log.parameters.trim)
    )
    return t, *errors(t, q, truth)


SAID = re.compile(r"(tilt|heading) [\d.]+.{1,60}? from ([\d.]+) s to ([\d.]+) s", re.IGNORECASE)


def accused(log: FlightLog, checks: Iterable[Check], ref: Reference) -> list[tuple[str, str, float, float, str]]:
    """Check, angle, time and words of each accusation of the attitude that flew."""
    end = log.seconds if log.seconds > 0 else np.inf
    found: list[tuple[str, str, float, float, str]] = []
    for check in checks:
        if check.verdict not in BAD:
            continue
        if check.question.startswith("onboard") or check.question == "heading_by_gnss":
            said = [match.groups() for text in (check.text, *check.evidence) for match in SAID.finditer(text)]
            spans = [(angle.lower(), float(a), float(b)) for angle, a, b in said]
            own = (check.about or "heading", check.t or 0.0, end if check.t_end is None else check.t_end)
            spans += [] if any(angle == own[0] for angle, *_ in spans) else [own]
            found += [(check.question, *span, check.text) for span in spans]
        if check.question == "second_source" and f"{log.onboard} is wrong" in check.text:
            found.append((check.question, check.about, check.t or 0.0, end, check.text))
    if ref.faults.refused.get("onboard", "") not in (
        "",
        ref.faults.onboard_heading,
    ):  # a wrong heading has its own check
        found.append(("refused", "tilt", 0.0, end, ref.faults.refused["onboard"]))
    return found


def judged(log: FlightLog) -> tuple[Reference, Segments, list[Check], dict[str, float | str]]:
    """The reference of a log without truth as an analysis chooses it, the audit, what the smoother says of itself."""
    quality: dict[str, float | str] = {}

    def smooth() -> Estimate:
        estimate = replay.smoother(log, phases, ReferenceOptions())
        quality.update(estimate.quality)
        return estimate

    with log_cache():
        phases = segments.build(log)
        ref = reference.choose(log, phases, smooth=smooth)
        return ref, phases, run_checks(HealthCase(log, phases, ref)), quality


def rms(x: Array) -> float | None:
    x = x[np.isfinite(x)]
    return float(np.sqrt(np.mean(x**2))) if len(x) else None


def outcome(name: str, log: FlightLog, fault: str, middle: float) -> Outcome:
    """Plant one fault into a copy of a log and score what is said of it."""
    clock = time.process_time()
    truth, log.truth = log.truth, None
    copy = deepcopy(log)
    log.truth = truth
    assert truth is not None
    (FAULTS | other_faults.FAULTS)[fault](copy, middle, np.random.default_rng(zlib.crc32(f"{name} {fault}".encode())))
    ref, phases, checks, quality = judged(copy)
    own: dict[str, float | None] = dict.fromkeys(("tilt", "heading", "tilt z", "heading z", "tilt ratio"))
    t, *onboard = onboard_errors(copy, truth)
    if ref.kind == "smoother" and ref.sigma is not None:
        q = ref.q if ref.alignment.trim is None else alignment.apply_trim(ref.q, -ref.alignment.trim)
        use = scoring.scored_mask(ref, ref.t)
        air, air_onboard = (phases.mask(x, "airborne") & scoring.scored_mask(ref, x) for x in (ref.t, t))
        for angle, error, sigma, flown in zip(
            ("tilt", "heading"),
            errors(ref.t, q, truth),
            (ref.sigma.tilt_deg, ref.sigma.heading_deg),
            onboard,
            strict=True,
        ):
            if angle == "heading" and ref.heading.by != "own":
                continue
            own[angle], own[f"{angle} z"] = rms(error[use]), rms(error[use] / sigma[use])
            mine, theirs = rms(error[air]), rms(flown[air_onboard])
            own[f"{angle} ratio"] = mine / theirs if mine is not None and theirs else None
    accusations = []
    for check, angle, t0, t1, text in accused(copy, checks, ref):
        inside = np.abs(onboard[angle == "heading"])[(t >= max(t0, ref.scoring.start)) & (t <= t1)]
        inside = inside[np.isfinite(inside)]
        accusations.append(Accusation(check, angle, t0, t1, float(np.median(inside)) if len(inside) else None, text))
    return Outcome(
        name,
        fault,
        ref.kind,
        ref.heading.by,
        ref.heading.why,
        own["tilt"],
        own["heading"],
        own["tilt z"],
        own["heading z"],
        own.get("tilt ratio"),
        own.get("heading ratio"),
        accusations,
        [f"{check.question}: {check.text}" for check in checks if check.verdict in BAD],
        dict(ref.faults.refused),
        quality,
        time.process_time() - clock,
    )


def middle_of(log: FlightLog) -> float:
    """The middle of the longest flight, of the log where there is none."""
    spans = segments.build(log).spans("airborne") or [(0.0, log.seconds)]
    a, b = max(spans, key=lambda span: span[1] - span[0])
    return 0.5 * (a + b)


def simulated(folder: Path) -> list[Path]:
    """The scenarios, flown and written as ULog (seed 1) or DataFlash (seed 2)."""
    from attlog.simulate.fly import fly
    from attlog.simulate.logs import recording
    from attlog.simulate.scenario import load_scenario

    paths = []
    for scenario in SCENARIOS:
        for seed, suffix, kind in ((1, ".ulg", "ulog"), (2, ".bin", "dataflash")):
            path = folder / f"{scenario}-{seed}{suffix}"
            formats.write(path, recording(fly(load_scenario(scenario), seed), kind))
            paths.append(path)
    return paths


def beyond(values: Sequence[float | None]) -> str:
    """``3 of 20 (median 0.7, worst 4.1)``."""
    known = [v for v in values if v is not None]
    if not known:
        return "-"
    return f"{sum(v > 2.0 for v in known)} of {len(known)} ({np.median(known):.1f}, {max(known):.1f})"


def row(fault: str, of: Sequence[Outcome]) -> str:
    """A line of the table."""
    kept = [o for o in of if o.kept]
    accusations = [a for o in of for a in o.accusations]
    angle = "tilt" if "tilt" in fault else "heading"
    named = sum(any(a.angle == angle and not a.false for a in o.accusations) for o in of)
    cells = [
        str(len(of)),
        str(len(kept)),
        str(sum(o.heading_by == "own" for o in kept)),
        beyond([o.heading_sigmas for o in kept]),
        beyond([o.tilt_sigmas for o in kept]),
        f"{sum(a.false for a in accusations)} of {len(accusations)}",
        str(named) if fault.startswith(ONBOARD) else "-",
    ]
    return f"| {fault} | {' | '.join(cells)} |"


def table(found: Sequence[Outcome]) -> str:
    """All faults, and what an untouched flight is worth."""
    lines = [
        "| planted | flights | kept | heading | heading beyond 2 sigma (median, worst) | tilt beyond 2 sigma "
        "| sound accused | named |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    lines += [
        row(fault, of) for fault in (FAULTS | other_faults.FAULTS) if (of := [o for o in found if o.fault == fault])
    ]
    planted = [o for o in found if o.fault != "nothing" and not o.fault.startswith(ONBOARD)]
    lines += [row("all faults of sensors", planted)] if planted else []
    sound = [o for o in found if o.fault == "nothing"]
    for angle in ("tilt", "heading"):
        ratios = [r for o in sound if (r := getattr(o, f"{angle}_ratio")) is not None]
        if ratios:
            lines.append(f"{angle} in the air, smoother over onboard: median {np.median(ratios):.3f} of {len(ratios)}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("flights", nargs="*", help="parts of file names; all without")
    parser.add_argument("--corpus", default=os.environ.get("ATTLOG_CORPUS", ""))
    parser.add_argument("--simulated", action="store_true", help="add scenarios of attlog simulate")
    parser.add_argument("--others", action="store_true", help="other faults instead")
    parser.add_argument("--faults", default="", help="parts of names of faults; all without")
    parser.add_argument("--json", type=Path, help="save every outcome")
    parser.add_argument("--verbose", "-v", action="store_true")
    given = parser.parse_args()
    known = other_faults.FAULTS if given.others else FAULTS
    wanted = [fault for fault in known if any(part in fault for part in given.faults.split(","))]
    found: list[Outcome] = []
    with TemporaryDirectory() as folder:
        paths = sorted(p for p in (Path(given.corpus) / "sitl").rglob("*") if p.suffix in (".ulg", ".bin"))
        paths += simulated(Path(folder)) if given.simulated else []
        for path in paths:
            if given.flights and not any(part in path.name for part in given.flights):
                continue
            log = flight.read(path)
            if log.truth is None or log.onboard_attitude is None:
                continue
            middle = middle_of(log)
            for fault in wanted:
                found.append(outcome(path.name, log, fault, middle))
                if given.verbose:
                    print(told(found[-1]), flush=True)
            if given.json:
                given.json.write_text(json.dumps([asdict(o) for o in found], indent=0))
    print(table(found))
    print(f"{len(found)} copies, {sum(o.cpu_s for o in found):.0f} s of processor time")


def told(o: Outcome) -> str:
    """One outcome in a line, and its accusations."""
    numbers = (o.tilt_deg, o.tilt_sigmas, o.heading_deg, o.heading_sigmas)
    shown = " ".join("    -" if x is None else f"{x:5.2f}" for x in numbers)
    lines = [f"{o.flight:26} {o.fault:36} {o.kind:8} {o.heading_by:7} {shown} {o.cpu_s:.1f} s"]
    for a in o.accusations:
        error = "?" if a.error_deg is None else f"{a.error_deg:.1f}"
        lines.append(f"    {'FALSE' if a.false else 'right'} ({a.angle} {error} deg off by truth): {a.text}")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
