"""``attlog simulate``: names, files, seeds and values on the command line."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from attlog import flight as flights
from attlog.cli.commands.simulate import paper_lines
from attlog.core.errors import UsageError
from attlog.reproduce import lyu
from attlog.simulate.scenario import build_scenario, load_scenario, scenario_names
from attlog.simulate.scenario_text import override_values, parse_seeds, scenario_toml
from tests.conftest import SAMPLES
from tests.reproduce.made import paper

SHORT = ("--set", "seconds=3")

pytestmark = pytest.mark.usefixtures("interruptible")


def test_one_flight_becomes_several_logs(attlog, tmp_path):
    paths = [tmp_path / f"x{suffix}" for suffix in (".ulg", ".bin", ".tlog")]
    done = attlog("simulate", "static", *SHORT, *(word for path in paths for word in ("-o", path)))
    assert (done.code, done.err) == (0, "")
    assert [line.split(":")[0] for line in done.out.splitlines()] == [str(path) for path in paths]
    for path in paths:
        assert flights.read(path).simulated


def test_what_a_shorter_flight_leaves_out_is_told_and_the_rest_flown(attlog, tmp_path):
    words = ("simulate", "hover", "--set", "seconds=20", "-o", tmp_path / "x.ulg")
    done = attlog(*words, "--print")
    assert done.code == 0
    assert done.err.splitlines() == [
        "attlog: hover.toml: command[2]: hold at 26 s is not flown; the flight ends after 20 s (seconds)",
        "attlog: hover.toml: command[3]: land at 86 s is not flown; the flight ends after 20 s (seconds)",
    ]
    assert attlog(*words, "--print", "-q").err == ""


def test_a_folder_gets_a_log_of_each_seed_in_each_format(attlog, tmp_path):
    done = attlog(
        "simulate",
        "static",
        *SHORT,
        "--seeds",
        "9..10,3",
        "-o",
        tmp_path / "all",
        "--format",
        "ulg",
        "--format",
        "bin",
        "-q",
    )
    assert (done.code, done.out) == (0, "")
    made = {path.name for path in (tmp_path / "all").iterdir()}
    assert made == {f"static-{n}{suffix}" for n in ("03", "09", "10") for suffix in (".ulg", ".bin")}
    alone = tmp_path / "alone.ulg"
    assert attlog("simulate", "static", *SHORT, "--seed", "9", "-o", alone).code == 0
    assert alone.read_bytes() == (tmp_path / "all" / "static-09.ulg").read_bytes()


def test_a_scenario_of_ones_own_begins_with_one_that_is_printed(attlog, tmp_path):
    own = tmp_path / "mine.toml"
    printed = attlog("simulate", "static", "--print")
    own.write_text(printed.out.replace('name = "static"', 'name = "mine"'))
    assert attlog("simulate", own, *SHORT, "-o", tmp_path).code == 0
    assert attlog("simulate", "static", *SHORT, "-o", tmp_path / "theirs.ulg").code == 0
    log, theirs = (flights.read(tmp_path / name) for name in ("mine.ulg", "theirs.ulg"))
    assert (log.imus[0].gyro.x == theirs.imus[0].gyro.x).all()
    assert "scenario: mine" in {text for _, _, text in log.texts}


@pytest.mark.parametrize("name", scenario_names())
def test_a_printed_scenario_is_the_scenario(name):
    assert build_scenario(tomllib.loads(scenario_toml(load_scenario(name)))) == load_scenario(name)


def test_what_is_set_is_printed_and_every_value_is(attlog):
    done = attlog(
        "simulate", "hover", "--print", "--set", "sensors.imu.1.gyro.bias_dps=[1,2,3]", "--estimator", "mahony"
    )
    values = tomllib.loads(done.out)
    assert values["sensors"]["imu"][1]["gyro"]["bias_dps"] == [1.0, 2.0, 3.0]
    assert values["sensors"]["baro"][0]["rate_hz"] == 25.0
    assert values["estimator"]["name"] == "mahony"
    assert attlog("simulate", "hover", "--print", "--set", "sensors.mag=[]").out.count("mag = []") == 1


@pytest.mark.slow
def test_several_processes_write_the_same(attlog, tmp_path):
    for jobs in (1, 2):
        done = attlog("simulate", "static", *SHORT, "--seeds", "1..3", "-j", jobs, "-o", tmp_path / str(jobs))
        assert done.code == 0, done.err
        assert len(done.out.splitlines()) == 3
    for path in (tmp_path / "1").iterdir():
        assert path.read_bytes() == (tmp_path / "2" / path.name).read_bytes()
    bad = attlog("simulate", "static", *SHORT, "--seeds", "1..3", "-j", 2, "-o", "/proc/none")
    assert bad.code == 73


def test_values_and_parameters_are_taken_from_the_command_line(attlog, tmp_path):
    path = tmp_path / "x.bin"
    done = attlog(
        "simulate",
        "static",
        *SHORT,
        "--set",
        "sensors.imu.rate_hz=200",
        "--param",
        "COMPASS_DEC=0.5",
        "--estimator",
        "madgwick@marg",
        "-o",
        path,
    )
    assert done.code == 0, done.err
    log = flights.read(path)
    assert log.imus[0].gyro.rate == pytest.approx(200.0, rel=1e-3)
    assert log.param("COMPASS_DEC") == 0.5
    assert any("madgwick@marg" in text for _, _, text in log.texts)


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (("hovr", "-o", "x.ulg"), 2, "did you mean hover?"),
        (("static",), 2, "-o static.ulg"),
        (("-o", "x.ulg"), 2, "name a scenario"),
        (("static", "-o", "x.csv"), 2, "x.csv: the suffix names the format"),
        (("static", "-o", "x.ulg", "--format", "bin"), 2, "--format is for a folder"),
        (("static", "-o", "folder", "--format", "csv"), 2, "use ulg, bin, tlog or mcap"),
        (("static", "-o", "x.ulg", "--seeds", "1..3"), 2, "-o must be a folder"),
        (("static", "-o", "folder", "--seeds", "3..1"), 2, "no range"),
        (("static", "-o", "folder", "--seeds", "a"), 2, "whole numbers"),
        (("static", "-o", "folder", "--seeds", "1..3", "--seed", "1"), 2, "--seed or --seeds"),
        (("static", "-o", "x.ulg", "--set", "seconds"), 2, "write KEY=VALUE"),
        (("static", "-o", "x.ulg", "--set", "secnods=3"), 2, "did you mean seconds?"),
        (("static", "-o", "x.ulg", "--set", "seconds=-3"), 2, "seconds: must be greater"),
        (("static", "-o", "x.ulg", "--set", "sensors.imu.2.rate_hz=3"), 2, "there are 1 of imu"),
        (("static", "-o", "x.ulg", "--set", "seconds.x=3"), 2, "has nothing below it"),
        (("static", "-o", "x.ulg", "--param", "A=b"), 2, "NAME=VALUE with a number"),
        (("static", "-o", "x.ulg", "--estimator", "smoother"), 2, "cannot fly"),
        (("none.toml", "-o", "x.ulg"), 66, "none.toml: no such file"),
        (("static", *SHORT, "-o", "/proc/none/x.ulg"), 73, "cannot be written"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(attlog, tmp_path, monkeypatch, words, code, says):
    monkeypatch.chdir(tmp_path)
    done = attlog("simulate", *words)
    assert done.code == code
    assert says in done.err
    assert len(done.err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_an_interrupted_run_keeps_whole_files_only(tmp_path: Path):
    command = [sys.executable, "-m", "attlog", "simulate", "static", "--seeds", "1..400", *SHORT, "-o", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        run.stdout.readline()
        run.send_signal(2)
        assert run.wait(60) == 130
    made = sorted(path.name for path in tmp_path.iterdir())
    assert made
    assert all(name.endswith(".ulg") for name in made)


def test_values_are_set_in_tables_lists_and_lists_of_tables():
    values = {"seconds": 5, "fault": [{"t": 1.0, "part": "mag", "kind": "zero"}]}
    found = override_values(
        values,
        [
            "seconds=7",
            "fault.1.t=2",
            "fault[1].part=gyro",
            "fault.1.kind=stuck",
            "fault.t=3",
            "sensors.imu.1.rate_hz=200",
            "sensors.mag.hard_iron_ut=[1, 2, 3]",
            "estimator.name=mahony:kp=1",
            "place.date=2024-01-01T00:00:00Z",
        ],
    )
    assert values["seconds"] == 5
    scenario = build_scenario(found)
    assert (scenario.seconds, scenario.estimator.name) == (7.0, "mahony:kp=1")
    assert [(f.t, f.part, f.kind) for f in scenario.fault] == [(3.0, "mag", "zero"), (3.0, "gyro", "stuck")]
    assert [imu.rate_hz for imu in scenario.sensors.imu] == [400.0, 200.0]
    assert scenario.sensors.mag[0].hard_iron_ut == (1.0, 2.0, 3.0)
    assert scenario.place.date.year == 2024
    with pytest.raises(UsageError, match=r"no fault yet; write fault\.0\.t"):
        override_values({}, ["fault.t=3"])


def test_seeds_are_ranges_and_lists():
    assert parse_seeds("7") == [7]
    assert parse_seeds("1..3, 2,9") == [1, 2, 3, 9]
    for text in ("", "-1", "1..", "2..1", "0..10000", "1-3"):
        with pytest.raises(UsageError):
            parse_seeds(text)


def test_logs_of_one_flight_are_written_all_or_none(attlog, tmp_path):
    old = b"\xa3\x95 attlog 0.20.0 simulated this flight, seed 0"
    (tmp_path / "a.bin").write_bytes(old)
    (tmp_path / "file").write_text("")
    outputs = ["-o", tmp_path / "a.bin", "-o", tmp_path / "file" / "b.tlog"]
    done = attlog("simulate", "static", "--set", "seconds=2", *outputs)
    assert (done.code, "file: cannot be written" in done.err) == (73, True), done.err
    assert (tmp_path / "a.bin").read_bytes() == old
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.bin", "file"]


# ``attlog reproduce``: pages, JSON, the claims on the terminal, and what is refused.


def test_a_paper_is_told_on_the_terminal_and_written_as_page_and_json(
    attlog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lyu, "paper", lambda options: replace(paper(), key="lyu", seeds=options.seeds))
    done = attlog("reproduce", "lyu", "--seeds", "2", "-j", "1", "-o", tmp_path)
    assert done.code == 0, done.err
    assert "does not hold" in done.out
    assert {p.name for p in tmp_path.iterdir()} == {"reproduce-lyu.html", "reproduce-lyu.json"}
    told = json.loads((tmp_path / "reproduce-lyu.json").read_text(encoding="utf-8"))
    assert (told["key"], told["seeds"]) == ("lyu", 2)
    assert done.out.splitlines()[-1] == f"page: {tmp_path / 'reproduce-lyu.html'}"
    done = attlog("reproduce", "lyu", "--seeds", "2", "-j", "1", "-o", tmp_path, "-q", "--json")
    assert json.loads(done.out)["claims"] == told["claims"]


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["lyi"], 2, "did you mean lyu"),
        (["lyu", "--logs", "none.ulg"], 66, "none.ulg"),
        (["lyu", "--logs", SAMPLES], 2, "--logs"),
    ],
)
def test_what_no_paper_is_and_logs_that_it_cannot_use_are_refused(attlog, tmp_path: Path, words, code, said) -> None:
    done = attlog("reproduce", *words, "-o", tmp_path)
    assert (done.code, done.out, said in done.err) == (code, "", True)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("width", [70, 200])
def test_claims_are_a_table_that_fits_the_terminal(width: int) -> None:
    lines = [line.text for line in paper_lines(paper(), Path("a.html"), width=width)]
    assert max(map(len, lines)) <= width
    rows = [line for line in lines if re.match(r"\d\. Claim", line)]
    assert [row.split("  ")[-1].strip() for row in rows] == [
        "holds",
        "holds in part",
        "does not hold",
        "cannot be judged",
    ]
    assert "0.80× (0.70 to" in rows[0]
    assert lines[-2:] == ["1 holds, 1 holds in part, 1 does not hold, 1 cannot be judged", "page: a.html"]
