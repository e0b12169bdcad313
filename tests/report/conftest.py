"""Results as a flight would give them, made by hand so that every figure has something to show."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from attlog.health.check import Setting, unknown
from attlog.health.findings import Finding
from attlog.metrics.metric import Answer, missing
from attlog.metrics.trace import Trace
from attlog.reference.model import AlignmentStep
from attlog.report.figures.catalogue import Album
from attlog.result import Check, EstimatorRow, ParameterValue, ReferenceSummary, Result
from attlog.segments.model import Segment
from attlog.story.flight_events import Event
from attlog.words.answers import verdicts

NAMES = ("gyro", "complementary@fan", "mahony@xu-0.6", "madgwick@marg", "vqf")
TITLES = {"mahony": "Mahony's explicit complementary filter", "vqf": "VQF, by its authors' own package"}
SECONDS, RATE = 200.0, 100.0
REST = (5.0, 45.0)
AIR = (60.0, 185.0)
AXES = ("roll", "pitch", "heading")


def flight(seed: int = 1) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times and the true roll, pitch, heading of a flight with rest, steps and turns."""
    t = np.arange(0, SECONDS, 1 / RATE)
    flying = (t > AIR[0]) & (t < AIR[1])
    steps = 25 * np.sign(np.sin(2 * np.pi * t / 12)) * flying
    kernel = np.hanning(31) / np.hanning(31).sum()
    roll = np.convolve(steps, kernel, "same")
    pitch = np.convolve(np.roll(steps, 400), kernel, "same") * 0.6
    heading = np.where(flying, 140 + 2.2 * (t - AIR[0]), 140.0)
    heading = np.where(t >= AIR[1], 140 + 2.2 * (AIR[1] - AIR[0]), heading)
    return t, {"roll": roll, "pitch": pitch, "heading": (heading + 180) % 360 - 180}


def answer(value: float, unit: str, window: str, spread: float = 0.1, **more: object) -> Answer:
    """A value with an interval around it."""
    return Answer(
        value, unit, window, n=28, seconds=40.0, ci95=(value - spread, value + spread), method="for the tests", **more
    )


def row(name: str, i: int, **changes: object) -> EstimatorRow:
    """A replayed row whose numbers grow with ``i``."""
    noise = (0.0031, 0.018, 0.0042, 0.0441, 0.0035)[i % 5]
    lag = (2.0, -120.0, 12.0, 8.0, -1.0)[i % 5]
    drift = (-1.2, -0.43, -0.14, 0.16, -0.05)[i % 5]
    bent = i % 5 == 1
    lag_answer = (
        missing("not_a_pure_delay", "follows 51 % of the step; a delay fitted to that means nothing", "ms", "airborne")
        if bent
        else answer(lag, "ms", "airborne", 1.5)
    )
    gain = answer(0.51 if bent else 1.01, "", "airborne", 0.03)
    values = dict(
        name=name,
        kind="replay",
        estimator=name.partition("@")[0],
        preset=name.partition("@")[2] or None,
        parameters={
            "kp": ParameterValue(0.6, "preset", "1/s", "gain of the correction"),
            "ki": ParameterValue(0.0, "default"),
        },
        metrics={
            "rest": {
                "noise_tilt_deg": answer(noise, "deg", "rest", noise / 10),
                "noise_roll_deg": answer(noise, "deg", "rest", noise / 10),
                "noise_pitch_deg": answer(noise * 0.9, "deg", "rest", noise / 10),
                "noise_heading_deg": answer(noise * 2, "deg", "rest", noise / 10),
                "drift_rest_deg_per_min": answer(drift, "deg/min", "rest", 0.1),
            },
            "airborne": {
                "lag_ms": lag_answer,
                "step_error_deg.0.5s": answer((0.2, 12.7, 8.0, 1.5, 0.4)[i % 5], "deg", "airborne", 0.1),
                "step_error_pct.0.5s": answer((0.4, -51.8, -25.2, -4.8, 1.6)[i % 5], "%", "airborne", 1.0),
                "lag_roll_ms": lag_answer,
                "step_gain": gain,
                "step_gain_roll": gain,
                "distortion_roll_pct": answer(3.0 + 20 * bent, "pct", "airborne", 1),
                "drift_air_deg_per_min.onboard": answer(drift * 2, "deg/min", "airborne", 1.0),
                "tilt_rmse_deg": answer(1.2 + i, "deg", "airborne"),
                "heading_rmse_deg": missing("no_magnetometer", "uses no magnetometer", "deg", "airborne")
                if name == "gyro"
                else answer(3.2 + i, "deg", "airborne"),
            },
            "all": {
                "convergence_s": answer(0.4 * i, "s", "all"),
                "cost_ns": answer(150.0 + 200 * i, "ns", "all", 10),
                "total_rmse_deg": answer(4.2 + i, "deg", "all"),
            },
        },
        skipped={"gap_bridged": 2},
        ns_per_update=150.0 + 200 * i,
        status="ok",
        title=TITLES.get(name.partition("@")[0], ""),
        uses_mag=name != "gyro",
    )
    return EstimatorRow(**(values | changes))


def onboard() -> EstimatorRow:
    """The attitude that flew, as the reference."""
    said = "it is the reference itself"
    return row(
        "onboard",
        3,
        kind="onboard",
        estimator="onboard",
        preset=None,
        parameters={},
        is_reference=True,
        ns_per_update=None,
        metrics={
            "rest": {
                "noise_tilt_deg": answer(0.012, "deg", "rest", 0.001),
                "noise_roll_deg": answer(0.012, "deg", "rest", 0.001),
                "noise_pitch_deg": answer(0.011, "deg", "rest", 0.001),
                "noise_heading_deg": answer(0.02, "deg", "rest", 0.001),
                "drift_rest_deg_per_min": answer(-5.7, "deg/min", "rest", 1.2),
            },
            "airborne": {
                m: missing("not_applicable", said, u, "airborne")
                for m, u in (("lag_ms", "ms"), ("tilt_rmse_deg", "deg"), ("heading_rmse_deg", "deg"))
            },
        },
    )


def traces(names: tuple[str, ...]) -> list[Trace]:
    """Every figure's arrays for the reference and the named rows."""
    t, truth = flight()
    random = np.random.default_rng(3)
    at_rest = (t > REST[0]) & (t < REST[1])
    in_air = (t > AIR[0]) & (t < AIR[1])
    out = [Trace("attitude", "onboard", t[::10], {a: truth[a][::10] for a in AXES})]
    for i, name in enumerate(names):
        size = 0.003 * (1 + 4 * (i % 5))
        error = {a: np.cumsum(random.normal(0, size, len(t))) * 0.2 + random.normal(0, size, len(t)) for a in AXES}
        error["heading"] = error["heading"] + 0.02 * (i % 5) * (t - 60) * in_air
        own = {a: (truth[a] + error[a] + 180) % 360 - 180 for a in AXES}
        out.append(Trace("attitude", name, t, own))
        coarse = {a: error[a][::10] for a in AXES}
        out.append(
            Trace(
                "difference",
                name,
                t[::10],
                coarse | {"tilt": np.hypot(coarse["roll"], coarse["pitch"]), "total": np.abs(coarse["heading"])},
            )
        )
        out.append(Trace("rest", name, t[at_rest], {a: error[a][at_rest] - error[a][at_rest].mean() for a in AXES}))
        tau = np.geomspace(0.02, 10, 20)
        deviation = size / np.sqrt(tau)
        columns = {"tau": tau, "deviation": deviation, "low": deviation * 0.8, "high": deviation * 1.3}
        out += [Trace("allan", name, tau, columns, axis) for axis in AXES]
        for key, span in (("rest", REST), ("onboard", AIR)):
            block = np.arange(span[0], span[1]) + 0.5
            slope = 0.01 * (i % 5 - 2)
            line = slope * (block - block.mean())
            out.append(
                Trace("drift", name, block, {"heading": line + random.normal(0, 0.2, len(block)), "line": line}, key)
            )
        if i:
            out.append(Trace("bias", name, t[::50], {a: np.full(len(t[::50]), 0.1 * i) for a in "xyz"}))
        start = 72.0
        near = (t > start - 0.5) & (t < start + 1.0)
        ref = truth["roll"][near] - truth["roll"][near][0]
        columns = {"est": np.roll(ref, i) * (1 - 0.1 * i), "ref": ref, "set": 25.0 * (t[near] >= start)}
        out.append(Trace("step", name, t[near] - start, columns, f"roll@{start:.2f}"))
        grid = np.linspace(-0.3, 1.2, 151)
        for axis in ("all axes", "roll", "pitch"):
            off = 10.0 * i * (grid > 0) * grid
            columns = {"median": off, "low": off - 3, "high": off + 3, "ref": 100 * (grid > 0.2)}
            out.append(Trace("steps", name, grid, columns, axis, values={"events": 6.0}))
        angle = np.linspace(-0.05, 0.05, 61)
        share = np.exp(-0.5 * (angle / size) ** 2)
        out.append(Trace("spread", name, angle, {"angle": angle, "share": 100 * share / share.sum()}))
    return [*out, *flown(t, truth), *sensors(t)]


def flown(t: np.ndarray, truth: dict[str, np.ndarray]) -> list[Trace]:
    """The set-point, half a second ahead, and the path over ground, whose heading is 20 deg off the course."""
    ahead = {a: np.roll(truth[a], -50)[::10] for a in AXES}
    second = t[(t > AIR[0]) & (t < AIR[1])][:: int(RATE)]
    course = 140 + 2.2 * (second - AIR[0])
    north, east = (np.cumsum(5 * f(np.radians(course))) for f in (np.cos, np.sin))
    columns = {"north": north, "east": east, "heading": course + 20, "course": course}
    columns |= {"speed": np.full(len(second), 5.0), "driven": np.ones(len(second))}
    values = {"least": 2.0, "forward": 0.0, "difference": 20.0, "low": 18.0, "high": 22.0, "seconds": 125.0}
    return [Trace("demand", "", t[::10], ahead), Trace("track", "", second, columns, "GPS:0", values=values)]


def sensors(t: np.ndarray) -> list[Trace]:
    """What the sensors' figures draw."""
    f = np.linspace(0.1, RATE / 2, 500)
    density = {a: (k + 1) / (1 + f) for k, a in enumerate("xyz")}
    second = np.arange(0.5, SECONDS)
    shaking = {a: 0.2 * (k + 1) * np.ones(len(second)) for k, a in enumerate("xyz")}
    size = {"low": 9.5 * np.ones(len(second)), "mean": 9.8 * np.ones(len(second)), "high": np.full(len(second), 10.2)}
    return [
        *(
            Trace("spectrum", "", f, {"frequency": f} | density, key, values={"nyquist_hz": RATE / 2, "seconds": 125.0})
            for key in ("gyro", "accelerometer")
        ),
        Trace("vibration", "", second, shaking | {"clipped": 1.0 * (second == 100.5)}, values={"samples": 1.0}),
        Trace("gravity", "", second, size, values={"expected": 9.81}),
        Trace("field", "", second, {k: 5 * v for k, v in size.items()}, values={"expected": 48.3}),
        Trace("throttle", "", second, {"throttle": 50.0 * ((second > AIR[0]) & (second < AIR[1]))}),
        Trace("rest_bias", "", np.array([25.0]), {a: np.array([0.2]) for a in "xyz"}),
        *health(second),
    ]


def health(t: np.ndarray) -> list[Trace]:
    """What the figures of the questions about the sensors draw; the compass reads 12 uT too much along x."""
    turned = {"x": 20 * np.cos(t / 20), "y": 20 * np.sin(t / 20), "z": np.full(len(t), 43.0)}
    fields = {a: y + (12.0 if a == "x" else 0.0) for a, y in turned.items()}
    fields |= {f"{part}_{a}": y for part in ("expected", "corrected") for a, y in turned.items()}
    drive = np.linspace(5.0, 40.0, 200)
    line = {"slope": 0.5, "start": -1.0, "r": 0.93, "seconds": 125.0}
    air = t[(t > AIR[0]) & (t < AIR[1])]
    level = {"p50": 20.0, "p80": 26.0, "worst": 48.0, "limit": 30.0, "fault": 60.0}
    tones = np.array([80.0, 160.0, 240.0]) / 10
    return [
        Trace("compass", "", t, fields, "MAG:0", values={"by_motion": 1.0}),
        Trace("interference", "", drive, {"residual": -1 + 0.5 * drive + np.sin(drive)}, "current", values=line),
        Trace("levels", "", air, {"level": 20 + 6 * np.sin(air)}, "VIBE", values=level),
        Trace("clipping", "", np.array([100.5]), {"samples": np.array([7.0])}, "VIBE.Clip0", values={"samples": 7.0}),
        Trace("rotor", "", tones, {"low": 0.9 * tones, "high": 1.1 * tones}),
        Trace("notches", "", tones[:1], {"low": 0.8 * tones[:1], "high": 1.2 * tones[:1]}, "set"),
        Trace("notches", "", tones[1:2], {"low": 0.8 * tones[1:2], "high": 1.2 * tones[1:2]}, "proposed"),
        Trace("ratios", "", t, {"ratio": np.where(t == 100.5, 9.0, 0.3)}, "compass"),
        Trace("ratios", "", t, {"ratio": 0.1 + 0.05 * np.sin(t)}, "velocity"),
    ]


def checks() -> list[Check]:
    """One of every verdict, with and without something to set."""
    ofs = [Setting("COMPASS_OFS_X", -12.5, -133.5, "mG"), Setting("COMPASS_OFS_Y", None, 0.0, "mG")]
    return [
        Check("accelerometer_rest", "ok", "The accelerometer reads 9.81 m/s² at rest.", 9.81, "m/s^2", "9.80 ± 0.3"),
        Check("field", "warning", "The magnetic field changes by 12 % with the throttle.", 12.0, "%", "below 10 %"),
        Check(
            "gnss_delay",
            "ok",
            "GNSS is 203 ms late, as set.",
            sensor="GPS:0",
            value=203.0,
            unit="ms",
            ci95=(190.0, 216.0),
        ),
        unknown("soft_iron", "The flight turned by 90 deg only: fly two full turns.", sensor="MAG:0"),
        Check(
            "vibration_level",
            "warning",
            "It vibrates by 48.0 m/s^2.",
            sensor="IMU:0",
            value=48.0,
            unit="m/s^2",
            t=100.5,
            action="Balance.",
        ),
        Check(
            "compass_offset",
            "fault",
            "MAG:0 reads 12.0 uT too much along x.",
            sensor="MAG:0",
            value=12.0,
            unit="uT",
            ci95=(10.0, 14.0),
            vector=[12.0, -0.5, 0.2],
            vector_ci95=[2.0, 2.0, 1.0],
            n=38,
            seconds=125.0,
            threshold="ok below 1.5 uT",
            source="the prototypes",
            settings=ofs,
            evidence=["Heading error of the other half falls from 15.5 deg to 1.5 deg."],
        ),
    ]


def _is_compared(row: EstimatorRow, metric: str, window: str) -> bool:
    found = row.metrics.get(window, {}).get(metric)
    return row.kind == "replay" and row.name != "gyro" and found is not None and found.value is not None


def unconfirmed_onboard() -> Result:
    """A result against an onboard attitude that nothing confirms: no tilt is ranked."""
    result = make_result()
    assert result.reference is not None
    result.reference.choice = "onboard"
    for window, metrics in result.ranked.items():
        for marks in (metrics, result.best.get(window, {}), result.worst.get(window, {})):
            marks.pop("tilt_rmse_deg", None)
    for answer in (w["tilt_rmse_deg"] for r in result.estimators for w in r.metrics.values() if "tilt_rmse_deg" in w):
        answer.ranked, answer.reason = False, answer.reason or "the onboard attitude is unproven"
    result.verdicts = verdicts(result)
    return result


def make_result(names: tuple[str, ...] = NAMES, with_traces: bool = True) -> Result:
    """A whole result with verdicts."""
    rows = [onboard(), *(row(name, i) for i, name in enumerate(names))]
    result = Result(
        attlog={"version": "0.1.0", "python": "3.11.9", "numpy": "2.4.6", "cpu": "x86-64, 2 cores"},
        command="attlog analyze flight.bin -o reports",
        config={"estimators": list(names), "reference": "auto", "imu": None, "gates": {}},
        log=dict(
            name="flight.bin",
            sha256="a4a3883fa13f28d55878c041cb4cc14deb3e5335aad6b9091f235c9b4e0d95f0",
            size=2_981_888,
            format="DataFlash",
            firmware={"name": "ArduPilot", "version": "4.5.7", "git": "2a3dc4b7", "board": "CubeOrange"},
            vehicle="Copter, quad",
            simulated=False,
            date_utc="2025-05-17T09:41:07Z",
            duration_s=SECONDS,
            t0_us=12_345_678,
            utc_offset=1.7e9,
            boot=0,
            boots=1,
            imu={
                "source": "IMU:0",
                "rate_hz": RATE,
                "sampling": "instant",
                "filtered": "low-pass 80 Hz",
                "index": 0,
                "device": None,
            },
            mag={"source": "MAG:0", "rate_hz": 10.0},
            attitude={"source": "ATT", "rate_hz": 10.0},
            place={"lat": 47.4, "lon": 8.5},
            seconds={"airborne": 125.0, "rest": 40.0, "armed": 135.0},
            timeline={
                "modes": [[0, 75, "STABILIZE"], [75, 150, "LOITER"], [150, 200, "RTL"]],
                "armed": [[55, 190]],
                "airborne": [list(AIR)],
                "texts": [
                    [2.0, 6, "ArduCopter V4.5.7 (2a3dc4b7)"],
                    [55.2, 5, "Arming motors"],
                    [104.0, 4, "EKF3 IMU0 yaw aligned"],
                    [149.8, 2, "Radio Failsafe - Continuing RTL"],
                    [190.1, 5, "Disarming motors"],
                ],
            },
            choices={
                "imu": "IMU:0 was replayed: it is the one that flew.",
                "attitude": "ATT is the primary lane's attitude.",
            },
            params_changed={"AHRS_TRIM_X": [0.0205, 0.0], "INS_GYRO_FILTER": [40, 20], "FRAME_TYPE": [1, None]},
        ),
        findings=[
            Finding("imu_slow", "warning", "The IMU was logged at 100 Hz behind a 40 Hz low-pass.", None),
            Finding("onboard_reset", "serious", "The onboard heading jumps by 15.7 deg without a rotation.", 103.4),
            Finding("text_truncated", "note", "3 messages were cut to 4096 characters.", count=3),
        ],
        segments=[
            Segment("continuous", 0, SECONDS, "one segment without a gap"),
            Segment("rest.long", *REST, "gyro below 0.15 deg/s, motors off"),
            Segment("armed", 55, 190, "EV arming events"),
            Segment("airborne", *AIR, "landed flag"),
            Segment("reset", 103.4, 103.4, "15.7 deg without rotation"),
            Segment("gap", 130.0, 130.4, "0.4 s without IMU samples"),
        ],
        reference=ReferenceSummary(
            "onboard",
            "ATT",
            10.0,
            0.003,
            "Compared with the onboard attitude: agreement, not truth.",
            [
                AlignmentStep("clock", "sample time of the IMU", "TimeUS", "", "log"),
                AlignmentStep(
                    "declination",
                    "world magnetic model at place and date",
                    2.9,
                    "deg",
                    "model",
                    True,
                    "config: declination",
                ),
                AlignmentStep("trim", "AHRS_TRIM taken out", "1.18, 0.30", "deg", "parameter", True, "config: trim"),
            ],
            scoring_start_s=15.0,
        ),
        estimators=rows,
        best={
            "rest": {
                "noise_tilt_deg": ["vqf", "mahony@xu-0.6"],
                "drift_rest_deg_per_min": ["mahony@xu-0.6", "madgwick@marg", "vqf"],
            },
            "airborne": {"lag_ms": ["vqf"], "tilt_rmse_deg": ["complementary@fan"]},
        },
        worst={"rest": {"noise_tilt_deg": ["madgwick@marg"]}, "airborne": {"lag_ms": ["mahony@xu-0.6"]}},
        ranked={
            window: {
                metric: [r.name for r in rows if _is_compared(r, metric, window)]
                for metric in dict.fromkeys(m for r in rows for m in r.metrics.get(window, {}))
            }
            for window in ("rest", "airborne", "all")
        },
        events=[Event("reset", 103.4, "note", "The onboard attitude was reset at 103.4 s: 15.7 deg without rotation.")],
        checks=checks(),
        timing={"read": 0.21, "estimators": 0.33},
        traces=traces(names) if with_traces else [],
    )
    result.verdicts = verdicts(result)
    return result


@pytest.fixture
def result() -> Result:
    """A good flight with five filters."""
    return make_result()


@pytest.fixture(scope="session")
def report(tmp_path_factory):
    """The report of the good flight, written once."""
    from attlog.report import write_report

    path = tmp_path_factory.mktemp("report") / "flight.html"
    write_report(make_result(), path)
    return path


# The figures of a made flight, drawn once.


@pytest.fixture(scope="package")
def album() -> Album:
    """The figures of a flight with three filters."""
    return Album.of(make_result(NAMES[:3]))


@pytest.fixture(scope="package")
def drawn(album: Album) -> dict[str, dict[str, Any]]:
    """All of them, data and layout."""
    return {name: album.drawn(name) for name in album.found}
