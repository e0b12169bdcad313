"""Records and rows of logs, and the file with every number of a batch."""

from __future__ import annotations

import csv
import importlib.util
import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from attlog import Config, Result, analyze
from attlog.batch.index_row import (
    SENSOR_WINDOW,
    THUMBNAIL_POINTS,
    encode_thumbnail,
    index_row,
    numbers,
    sensors_of,
    thumbnail,
)
from attlog.batch.job import Record
from attlog.batch.results_file import COLUMNS, CSV, PARQUET, write_results
from attlog.core.errors import OutputError
from attlog.metrics.trace import Trace
from attlog.result import MEASURED_TIMES, Event
from tests.conftest import SAMPLES
from tests.health.made import MADE, OFFSET, REFUSED, SILENT, SOUND
from tests.report.conftest import make_result


@pytest.mark.parametrize(
    ("code", "final"), [(0, True), (2, True), (65, True), (66, False), (70, False), (73, False), (75, False)]
)
def test_only_what_content_and_settings_decide_is_final(code: int, final: bool) -> None:
    """A timeout, too little memory, a bug or a full disk may end otherwise next time."""
    assert Record("a.ulg", "a", "key", code=code).is_final is final


# What a batch remembers of one log: plain, whole, the same every time, and all that its result says.


@pytest.fixture(scope="module")
def flown() -> Result:
    """A real flight in simulation, with truth."""
    return analyze(SAMPLES / "px4_steps.ulg", Config(estimators=["mahony", "gyro"]))


def test_a_row_is_plain_json_without_measured_times(flown: Result) -> None:
    row = index_row(flown)
    assert json.loads(json.dumps(row, allow_nan=False)) == row
    made = make_result()
    assert any(name in made.to_json() for name in MEASURED_TIMES)
    assert not [name for name in MEASURED_TIMES if f'"{name}"' in json.dumps(index_row(made))]


def test_every_answer_of_the_result_comes_back(flown: Result) -> None:
    found = {(n.row, n.window, n.metric): n for n in numbers(index_row(flown)["answers"])}
    expected = {
        (r.name, w, m): a
        for r in flown.estimators
        for w, answers in r.metrics.items()
        for m, a in answers.items()
        if m not in MEASURED_TIMES
    }
    of_sensors = {key for key in found if key[1] == SENSOR_WINDOW}
    assert {key[2] for key in of_sensors} == {a.question for a in flown.checks}
    assert found.keys() - of_sensors == expected.keys()
    for key, a in expected.items():
        n = found[key]
        assert (n.value, n.unit, n.code, n.reason if a.value is None else None) == (
            a.value,
            a.unit,
            a.code,
            a.reason if a.value is None else None,
        )
        if a.value is not None:
            assert ((n.low, n.high), n.n, n.seconds) == (a.ci95 or (None, None), a.n, a.seconds)
    assert sum(n.value is None for n in found.values()) > 10
    assert sum(n.value is not None for n in found.values()) > 100


def test_what_flew_when_and_the_four_sentences(flown: Result) -> None:
    row = index_row(flown)
    flight = row["flight"]
    assert (flight["vehicle"], flight["firmware"], flight["simulated"]) == ("quadrotor", "PX4 1.18.0 alpha", True)
    assert (flight["sha256"], flight["date_utc"]) == (flown.log["sha256"], None)
    assert flight["duration_s"] == pytest.approx(88.92)
    assert flight["airborne_s"] == pytest.approx(60.0, abs=1.0)  # 20.0 to 80.0 s by the true height
    assert [v["sentence"] for v in row["verdicts"]] == [v.sentence for v in flown.verdicts]
    assert {v["question"]: v["answered"] for v in row["verdicts"]}["accuracy"]
    tilt = next(c for c in row["columns"] if c["metric"] == "tilt_rmse_deg")
    value = next(r for r in flown.estimators if r.name == "mahony").metrics["airborne"]["tilt_rmse_deg"].value
    assert tilt["values"]["mahony"] == pytest.approx(value, rel=1e-5)
    assert tilt["window"] == "airborne"


T = np.linspace(0.0, 96.0, 961)


def leaning(*more: Trace) -> Result:
    """A log of 96 s in which the onboard attitude leans from 48 s on, with other traces."""
    made = make_result(("mahony@xu-0.6",), with_traces=False)
    half = np.where(T < 48.0, 0.0, 30.0)
    made.log |= {"duration_s": 96.0, "timeline": {"airborne": [[1.0, 95.0]]}}
    made.traces = [Trace("attitude", "onboard", T, {"roll": half, "pitch": -half, "heading": T}), *more]
    return made


def test_the_thumbnail_is_the_height_else_the_tilt() -> None:
    height = np.where(T < 48.0, 12.0, np.nan)
    seen = thumbnail(leaning(Trace("height", "", T, {"height": height})))
    assert seen is not None
    assert seen["height"] == [12.0] * (THUMBNAIL_POINTS // 2) + [None] * (THUMBNAIL_POINTS // 2)
    seen = thumbnail(leaning(Trace("height", "", T, {"height": height * np.nan})))
    assert seen is not None
    leaned = math.degrees(math.acos(math.cos(math.radians(30.0)) ** 2))
    assert seen["tilt"] == [0.0] * (THUMBNAIL_POINTS // 2) + [round(leaned, 1)] * (THUMBNAIL_POINTS // 2)
    never = leaning(Trace("height", "", T, {"height": np.full(len(T), 699.0)}))
    never.log["timeline"]["airborne"] = []
    assert set(thumbnail(never) or ()) & {"height", "tilt"} == {"tilt"}


def test_a_slow_height_is_drawn_as_a_line_and_a_long_gap_stays_one() -> None:
    at = np.array([1.0, 5.0, 9.0, 95.0])
    seen = thumbnail(leaning(Trace("height", "", at, {"height": np.array([0.0, 2.0, 4.0, 0.0])})))
    assert seen is not None
    assert seen["height"][:6] == [0.0, 1.0, 2.0, 3.0, 4.0, None]


def test_serious_events_are_marked_with_what_happened_and_those_of_one_place_once() -> None:
    made = leaning()
    made.events = [
        Event("impact", 70.02, "serious", "Hit the ground at 70.0 s: 5 g."),
        Event("overturn", 69.98, "serious", "Turned over at 70.0 s."),
        Event("reset", 20.0, "warning", "The onboard attitude was reset at 20.0 s."),
        Event("impact", 90.0, "serious", "Crashed again at 90.0 s."),
    ]
    seen = thumbnail(made)
    assert seen is not None
    assert seen["marks"] == [
        [70.0, "Turned over at 70.0 s. Hit the ground at 70.0 s: 5 g."],
        [90.0, "Crashed again at 90.0 s."],
    ]


def test_the_page_gets_a_byte_for_each_point_and_what_is_shown_in_words() -> None:
    out = bytearray()
    height = [0.0, 18.0, 36.0, None] + [0.0] * (THUMBNAIL_POINTS - 4)
    seen = {"t0": 0.0, "t1": 9.0, "height": height, "air": [], "marks": [[8.0, "It fell."]]}
    assert encode_thumbnail(seen, out) == [0, 0.0, 9.0, "Height over time", [], [[8.0, "It fell."]]]
    assert list(out[:4]) == [0, 127, 254, 255]
    assert encode_thumbnail(None, out) is None
    low = seen | {"height": [1.0, -4.0] + [0.0] * (THUMBNAIL_POINTS - 2)}
    assert encode_thumbnail(low, out) is not None
    assert list(out[THUMBNAIL_POINTS : THUMBNAIL_POINTS + 2]) == [254, 0]


def test_a_result_with_nothing_in_it_has_a_row() -> None:
    assert index_row(make_result(with_traces=False))["thumbnail"] is None
    row = index_row(Result({}, "", {}, {}))
    assert (row["reasons"], row["columns"], row["rows"], list(numbers(row["answers"]))) == ([], [], {}, [])


def test_odd_numbers_stay_out() -> None:
    made = make_result()
    made.estimators[0].metrics["rest"]["noise_tilt_deg"].value = math.inf
    made.log |= {"duration_s": math.nan, "name": "a\udcff<b>.ulg"}
    made.traces = [replace(t, t=t.t * np.nan) if t.row == "gyro" else t for t in made.traces]
    row = index_row(made)
    assert json.loads(json.dumps(row, allow_nan=False))["flight"]["duration_s"] is None


def test_a_row_counts_what_is_off_and_names_what_to_set() -> None:
    made = make_result()
    made.checks = [*MADE, replace(REFUSED, verdict="warning"), SOUND]
    told = index_row(made)["sensors"]
    assert told == {"faults": 1, "warnings": 2, "to_set": ["COMPASS_OFS_X -12 -> 145", "COMPASS_OFS_Y 4.5 -> -20.25"]}
    assert sensors_of({"sensors": told}) == told
    assert sensors_of({}) == {"faults": 0, "warnings": 0, "to_set": []}, "a row of an older version"


def test_assessments_are_numbers_of_their_sensor() -> None:
    made = make_result()
    made.checks = [OFFSET, SILENT]
    found = {n.row: n for n in numbers(index_row(made)["answers"]) if n.window == SENSOR_WINDOW}
    offset, silent = found["MAG.0"], found["GPS.0"]
    assert (offset.metric, offset.unit, offset.value) == ("compass_offset", "uT", 24.0)
    assert (offset.low, offset.high, offset.n, offset.seconds) == (21.0, 27.0, 40, 200.0)
    assert (silent.metric, silent.value, silent.code, silent.reason) == ("gnss_delay", None, "unknown", SILENT.text)


# One file with every number of a batch: what it says, in which units, and that it appears whole or not at all.


def flown_with_numbers(name: str = "a.ulg", **log: object) -> Record:
    made = make_result(with_traces=False)
    made.checks = []
    made.log |= {"name": name} | log
    return Record(f"logs/{name}", name, row=index_row(made))


FAILED = Record("logs/b.ulg", "b.ulg", code=65, message="b.ulg: not a log")


def expected(made: Result) -> dict[tuple[str, str, str], float | None]:
    return {
        (r.name, w, m): a.value
        for r in made.estimators
        for w, answers in r.metrics.items()
        for m, a in answers.items()
        if m not in MEASURED_TIMES
    }


@pytest.fixture
def without_pyarrow(monkeypatch: pytest.MonkeyPatch) -> None:
    real = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: None if name == "pyarrow" else real(name, *a))


def test_parquet_holds_a_line_for_each_log_row_window_and_metric(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    assert parquet.read_table(write_results(tmp_path, [FAILED])).num_rows == 0
    path = write_results(tmp_path, [flown_with_numbers(), FAILED, flown_with_numbers("c\udcff.ulg")])
    table = parquet.read_table(path)
    assert (path.name, table.column_names) == (PARQUET, list(COLUMNS))
    lines = table.to_pylist()
    values = expected(make_result(with_traces=False))
    assert len(lines) == 2 * len(values)
    assert {line["log"] for line in lines} == {"logs/a.ulg", "logs/c\\udcff.ulg"}
    found = {(x["row"], x["window"], x["metric"]): x for x in lines if x["report"] == "a.ulg"}
    assert {key: x["value"] for key, x in found.items()} == values
    lag = found["complementary@fan", "airborne", "lag_ms"]
    assert (lag["value"], lag["code"], lag["unit"]) == (None, "not_a_pure_delay", "ms")
    assert "51 %" in lag["reason"]
    noise = found["gyro", "rest", "noise_tilt_deg"]
    assert (noise["n"], noise["seconds"], noise["code"]) == (28, 40.0, None)
    assert noise["low"] < noise["value"] < noise["high"]


def test_units_stand_in_the_metadata(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    path = write_results(tmp_path, [flown_with_numbers()])
    schema = parquet.read_schema(path)
    assert schema.field("seconds").metadata[b"unit"] == b"s"
    assert schema.field("value").metadata[b"unit"] == b"see unit"
    units = json.loads(parquet.read_metadata(path).metadata[b"attlog.units"])
    assert (units["lag_ms"], units["noise_tilt_deg"], units["drift_rest_deg_per_min"]) == ("ms", "deg", "deg/min")


def test_csv_says_the_same_where_pyarrow_is_missing(tmp_path: Path, without_pyarrow: None) -> None:
    (tmp_path / PARQUET).write_bytes(b"PAR1 attlog.units of an earlier run PAR1")
    assert write_results(tmp_path, [FAILED]).read_text() == ",".join(COLUMNS) + "\n"
    path = write_results(tmp_path, [flown_with_numbers('odd "name", #1.ulg'), FAILED])
    assert [p.name for p in tmp_path.iterdir()] == [CSV]
    with path.open(encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    assert lines[0]["log"] == 'logs/odd "name", #1.ulg'
    values = expected(make_result(with_traces=False))
    found = {(x["row"], x["window"], x["metric"]): x["value"] for x in lines}
    assert {key: float(text) if text else None for key, text in found.items()} == values


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = write_results(tmp_path, [flown_with_numbers()])
    before = path.read_bytes()

    def broken() -> Iterator[Record]:
        yield flown_with_numbers("x.ulg")
        raise OSError(28, "No space left on device")

    with pytest.raises(OutputError, match="No space left"):
        write_results(tmp_path, broken())
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_every_line_tells_what_is_off_with_the_sensors_and_what_to_set(tmp_path: Path, without_pyarrow: None) -> None:
    made = make_result(with_traces=False)
    made.checks = list(MADE)
    entries = [Record("logs/off.ulg", "off.ulg", row=index_row(made)), flown_with_numbers()]
    with write_results(tmp_path, entries).open(newline="") as file:
        lines = list(csv.DictReader(file))
    told = {(x["report"], x["sensor_faults"], x["sensor_warnings"], x["to_set"]) for x in lines}
    assert told == {
        ("off.ulg", "1", "1", "COMPASS_OFS_X -12 -> 145; COMPASS_OFS_Y 4.5 -> -20.25"),
        ("a.ulg", "0", "0", ""),
    }
    (offset,) = [x for x in lines if x["metric"] == "compass_offset"]
    assert (offset["row"], offset["window"], offset["value"], offset["unit"]) == ("MAG.0", "sensors", "24.0", "uT")
