"""Estimators by name, by entry point and by file; what is wrong with a plug-in is said with its line."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog.core.errors import PluginError, UsageError
from attlog.estimators import DEFAULT, get, names, parse, select
from attlog.estimators.accuracy import FILE, SETS, read_accuracy
from tests.conftest import few

GOOD = '''"""Gyro and nothing else.

q' = q (x) (0, w)/2
"""
from attlog.estimators.vectors import turn
from attlog.estimators import Parameter
SOURCE = "test"
NEEDS = {"gyro"}
STATE = {"q": 4, "rate": 1, "_memory": 2}
PARAMETERS = (Parameter("scale", 1.0, "1", 0.5, 2.0, "gyro scale", "test"),)
PRESETS = {"slow": {"scale": 0.5}}

def start(params, acc, mag, q0):
    import numpy as np
    return np.concatenate([q0, np.zeros(3)])

def step(state, params, dt, gyr, acc, mag):
    state[4] = params[0] * gyr[2]
    turn(state, params[0] * gyr[0], params[0] * gyr[1], params[0] * gyr[2], dt, 0.0)
'''


@pytest.fixture
def plugin(tmp_path: Path) -> Path:
    file = tmp_path / "mine.py"
    file.write_text(GOOD)
    return file


def test_every_built_in_estimator_loads_and_says_what_it_is() -> None:
    assert {"gyro", "accel_mag", "complementary", "mahony"} <= set(names())
    for name in names():
        e = get(name)
        assert e.name == name
        assert e.title
        assert e.text
        assert e.source
        for preset in e.presets:
            e.resolve(preset)


@pytest.mark.parametrize("run", [True, False])
def test_a_file_is_an_estimator_with_presets_and_outputs(
    plugin: Path, run: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not run:
        monkeypatch.setenv("ATTLOG_NO_JIT", "1")
    t = np.arange(101) / 100
    gyr = np.tile([0, 0, 1.0], (101, 1))
    e = attlog.estimate(f"{plugin}@slow", t, gyr)
    assert e.q[-1] == pytest.approx([np.cos(0.25), 0, 0, np.sin(0.25)])
    assert set(e.aux) == {"rate"}
    assert e.aux["rate"][-1] == pytest.approx(0.5)
    assert parse(f"{plugin}@slow").name == "mine@slow"
    assert parse(f"{plugin}:scale=2").resolved()["scale"] == (2.0, "option")


@pytest.mark.parametrize(
    ("find", "put", "words"),
    few(
        [
            ("SOURCE =", "SOURCE = = ", "line 7: invalid syntax"),
            ("SOURCE =", "SOURCE = 1 / 0 #", "line 7: ZeroDivisionError"),
            ("from attlog.estimators.vectors", "from attlog.estimators.vektors", "line 5: ModuleNotFoundError"),
            ("def step", "def stop", "neither start and step nor run"),
            ('{"gyro"}', '{"gyro", "sonar"}', "not sonar"),
            ('"q": 4, ', "", 'must begin with "q": 4'),
            ('"rate": 1, "_memory": 2', '"_memory": 2, "rate": 1', "private parts come last"),
            ('"rate"', '"bias"', "bias must have size 3"),
            ('{"scale": 0.5}', '{"scale": 9}', "out of range"),
            ('{"scale": 0.5}', '{"skale": 1}', "did you mean scale"),
            ("(Parameter(", "(float, Parameter(", "must hold attlog.estimators.Parameter"),
            ("1.0,", "7.0,", "out of range"),
            ('("scale", ', '("init", ', "init belongs to the shared loop"),
            ("(Parameter(", '(Parameter("scale", 1.0, "", 0, 5, "a", "b"), Parameter(', "names scale twice"),
        ],
        5,
    ),
)
def test_a_broken_file_is_told_with_what_is_wrong(plugin: Path, find: str, put: str, words: str) -> None:
    plugin.write_text(GOOD.replace(find, put))
    with pytest.raises(PluginError) as told:
        get(str(plugin))
    assert words in str(told.value)
    assert "mine.py" in str(told.value)


@pytest.mark.slow
@pytest.mark.parametrize("jit", few(["0", "1"], 1))
@pytest.mark.parametrize(
    ("find", "put", "words"),
    [
        ("state[4] =", "undefined_name(3); state[4] =", "line 18: NameError: name 'undefined_name'"),
        ("np.zeros(3)", "np.zeros(1)", "STATE says (7,)"),
        ("return np", "return nq", "line 15: NameError"),
    ],
)
def test_a_file_that_fails_when_it_runs_is_told_too(
    plugin: Path, find: str, put: str, words: str, jit: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ATTLOG_NO_JIT", jit)
    plugin.write_text(GOOD.replace(find, put))
    with pytest.raises(PluginError) as told:
        attlog.estimate(str(plugin), np.arange(5.0), np.zeros((5, 3)))
    assert words in str(told.value)
    assert "mine.py" in str(told.value)


@pytest.mark.slow
def test_an_installed_package_can_bring_estimators(plugin: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(plugin.parent)
    about = plugin.parent / "mine-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[attlog.estimators]\nmy_filter = mine\ngone = no_such_module\n")
    assert names()[-2:] == ("gone", "my_filter")
    assert get("my_filter").presets == {"slow": {"scale": 0.5}}
    assert attlog.estimate("my_filter", [0.0, 0.1], np.zeros((2, 3))).q.shape == (2, 4)
    assert "mine" not in sys.modules, "its code runs in a process of its own"
    with pytest.raises(PluginError, match="no_such_module"):
        get("gone")
    rows = {r.name: r for r in select("all")}
    assert {"gone", "my_filter", "mahony"} <= set(rows)
    with pytest.raises(PluginError, match="no_such_module"):
        attlog.estimate(rows["gone"], [0.0, 0.1], np.zeros((2, 3)))


@pytest.mark.parametrize(
    "damaged", few([b"garbage\0\xff[attlog.estimators\n===\n", b"[attlog.estimators", b"\xff\xfe\0["], 1)
)
def test_a_package_whose_description_is_damaged_takes_no_other_with_it(
    damaged: bytes, plugin: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(plugin.parent)
    for name, points in (
        ("a_bad", damaged),
        ("mine", b"[attlog.estimators]\nmy_filter = mine\nno name! = mine\nx =\n"),
    ):
        (plugin.parent / f"{name}-1.0.dist-info").mkdir()
        (plugin.parent / f"{name}-1.0.dist-info" / "entry_points.txt").write_bytes(points)  # and no METADATA
    assert "my_filter" in names()
    assert "no name!" not in names()
    assert get("my_filter").presets == {"slow": {"scale": 0.5}}
    with pytest.raises(PluginError):
        get("x")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("mahny", "did you mean mahony"),
        ("mahony@xu-0.7", "did you mean xu-"),
        ("mahony:kp", "kp is not NAME=VALUE"),
        ("mahony:kp=1000", "out of range; give a value from 0 to 100 1/s"),
        ("nowhere/my.py", "no such estimator file"),
        ("", "no estimator named"),
        (",", "no estimator named"),
    ],
)
def test_what_is_not_known_is_refused_with_a_suggestion(text: str, words: str) -> None:
    with pytest.raises(UsageError) as told:
        select(text)
    assert words in str(told.value)


def test_a_list_keeps_order_and_parameters_and_drops_repeats() -> None:
    rows = select("mahony@xu-0.6, mahony:kp=1,ki=0.1 ,gyro,mahony@xu-0.6")
    assert [r.name for r in rows] == ["mahony@xu-0.6", "mahony:kp=1,ki=0.1", "gyro"]
    assert rows[1].resolved()["ki"] == (0.1, "option")
    assert rows[0].resolved()["kp"] == (0.6, "preset")
    assert rows[2].resolved()["init"] == ("average", "default")


def test_sets_leave_out_what_the_sensors_do_not_allow() -> None:
    assert [r.name for r in select("default")] == list(DEFAULT)
    everything = {r.name for r in select("all")}
    assert everything == set(names())
    assert everything - {r.name for r in select("all", mag=False)} == {n for n in names() if "mag" in get(n).needs}
    assert everything - {r.name for r in select("all", gnss=False)} == {n for n in names() if "gnss" in get(n).needs}
    assert [r.name for r in select("accel_mag", mag=False)] == ["accel_mag"]
    assert "gyro" in {r.name for r in select("default", acc=False, mag=False)}


def test_listing_names_imports_no_filter() -> None:
    import subprocess
    import sys

    code = (
        "import sys, attlog.estimators as e; e.names();"
        "print([m for m in sys.modules if m in ('numba', 'scipy', 'vqf')])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


# The file of measured accuracies: what it holds, and that its reader takes it as it stands.

HEADING_TOLD = {"gsf": 20}
"""Of the simulated flights those in which GNSS motion tells a heading: no others are trials of such a filter."""


def test_every_filter_of_attlog_was_measured_on_all_trials() -> None:
    trials = {"broad": 15, "euroc": 4, "simulated": 24, "simulated_unbiased": 24}
    assert set(SETS) == set(trials)
    for name in names():
        if name in read_accuracy():  # a filter of a package that is installed here was not
            assert {key: one.trials for key, one in read_accuracy()[name].items()} == {
                key: HEADING_TOLD.get(name, n) for key, n in trials.items() if key in read_accuracy()[name]
            }
    assert {"gyro", "mahony", "mekf", "vqf", "smoother"} <= set(read_accuracy())


def test_each_mean_lies_in_its_interval_and_no_part_exceeds_the_whole() -> None:
    for name, sets in read_accuracy().items():
        for key, one in sets.items():
            assert ("total" in one.rmse_deg) == (key != "euroc" and name != "package riann"), name
            for rmse in one.rmse_deg.values():
                assert rmse.low is not None
                assert rmse.high is not None
                assert 0.0 < rmse.low < rmse.value < rmse.high
                # the interval is symmetric in the logarithm
                assert rmse.low * rmse.high == pytest.approx(rmse.value**2, rel=5e-3)
            if "total" in one.rmse_deg:
                assert max(one.rmse_deg[a].value for a in ("heading", "tilt")) <= one.rmse_deg["total"].value


def test_the_reader_takes_every_line() -> None:
    with FILE.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == sum(map(len, read_accuracy().values()))
    for row in rows:
        one = read_accuracy()[row["filter"]][row["set"]]
        assert [one.rmse_deg[a].value for a in one.rmse_deg] == [float(row[a]) for a in one.rmse_deg]
        assert (one.ns, one.version, one.date) == (float(row["ns"]), row["version"], row["date"])
