"""``attlog estimators``, ``new`` and ``check-estimator``: from the list to a filter of one's own."""

from __future__ import annotations

import json
import os

import pytest


def test_the_list_names_every_filter_with_source(attlog):
    from attlog.estimators import get, names

    done = attlog("estimators")
    assert done.code == 0
    for name in names():
        assert name in done.out
        assert get(name).source.split()[0] in done.out


def test_the_list_shows_needs_errors_and_cost_within_100_columns(attlog):
    from attlog.estimators.accuracy import measured

    lines = attlog("estimators").out.splitlines()
    begin = next(i for i, line in enumerate(lines) if "BROAD °" in line)
    end = lines.index("", begin)
    shown = {line.split()[0]: line for line in lines[begin + 1 : end]}
    known = measured()["madgwick"]
    assert shown["madgwick"].split()[1:5] == [
        *(known[key].short() for key in ("broad", "euroc", "simulated")),
        f"{known['broad'].ns:.0f}",
    ]
    assert shown["madgwick"].endswith("gyro acc (mag)")
    assert shown["eskf"].endswith("gyro acc (mag aids)")
    assert shown["mahony_dcm"].split()[2] == "-"  # no magnetometer in EuRoC
    assert max(map(len, lines[begin:end])) <= 100


def test_json_tells_all_of_every_filter(attlog):
    from attlog.estimators import names

    rows = [json.loads(line) for line in attlog("estimators", "--json").out.splitlines()]
    assert [row["name"] for row in rows] == list(names())
    mahony = next(row for row in rows if row["name"] == "mahony")
    assert mahony["needs"] == ["acc", "gyro"]
    assert mahony["uses"] == ["mag"]
    total = mahony["accuracy"]["broad"]["rmse_deg"]["total"]
    assert total["low"] < total["value"] < total["high"]
    assert mahony["accuracy"]["broad"]["trials"] == 15
    assert mahony["accuracy"]["broad"]["version"]


def test_a_filter_of_ones_own_is_not_measured(attlog, tmp_path):
    file = str(tmp_path / "mine.py")
    attlog("new", file)
    assert attlog("estimators", file).out.rstrip().endswith("not measured")
    assert json.loads(attlog("estimators", file, "--json").out)["accuracy"] is None


def test_one_filter_is_explained_with_parameters_and_presets(attlog):
    done = attlog("estimators", "mahony")
    assert done.code == 0
    for word in ("kp", "1/s", "mahony@xu-0.6", "v x d", "Mahony"):
        assert word in done.out


def test_an_unknown_filter_is_2_with_a_suggestion(attlog):
    done = attlog("estimators", "mahonny")
    assert done.code == 2
    assert "did you mean mahony" in done.err


@pytest.mark.slow
def test_the_template_passes_the_checks_and_runs_in_an_analysis(attlog, samples, tmp_path):
    mine = tmp_path / "my_filter.py"
    assert attlog("new", mine).code == 0
    assert attlog("check-estimator", mine).code == 0
    done = attlog("analyze", samples / "px4_steps.ulg", "--estimators", f"gyro,{mine}", "-o", tmp_path, "--json", "-")
    assert done.code == 0, done.err
    rows = {r["name"]: r for r in json.loads(done.out)["estimators"]}
    assert rows["my_filter"]["status"] in ("ok", "not_converged")
    assert rows["my_filter"]["parameters"]


@pytest.mark.slow
def test_the_template_for_whole_segments_passes_the_checks(attlog, tmp_path):
    mine = tmp_path / "my_filter.py"
    assert attlog("new", "--run", mine).code == 0
    done = attlog("check-estimator", mine)
    assert done.code == 0, done.out
    assert "takes whole segments" in done.out


def test_the_template_for_whole_segments_agrees_with_the_filter_it_is(attlog, tmp_path):
    import numpy as np

    import attlog as package
    from attlog.testing import swing

    mine, m = tmp_path / "my_filter.py", swing(3.0)
    assert attlog("new", "--run", mine).code == 0
    wanted = package.estimate("mahony:kp=0.6,ki=0,init=first", *m.sensors)
    assert np.abs(package.estimate(str(mine), *m.sensors).q - wanted.q).max() < 1e-12


@pytest.mark.slow
def test_a_wrong_sign_fails_the_checks_with_1(attlog, tmp_path):
    mine = tmp_path / "my_filter.py"
    attlog("new", mine)
    mine.write_text(mine.read_text().replace("state[4] + kp * ex", "state[4] - kp * ex"))
    done = attlog("check-estimator", mine)
    assert done.code == 1
    assert "FAIL  converges from 170 deg" in done.out


def test_a_file_that_exists_is_kept(attlog, tmp_path):
    mine = tmp_path / "mine.py"
    mine.write_text("precious")
    assert attlog("new", mine).code == 73
    assert mine.read_text() == "precious"


def test_a_name_that_is_no_python_file_is_2(attlog, tmp_path):
    assert attlog("new", tmp_path / "mine.txt").code == 2
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("code", "words"),
    [("def step(:\n", "line 1"), ("x = 1\n", "start and step"), ("import nothing_like_this\n", "nothing_like_this")],
)
def test_a_broken_file_is_told_with_its_place(attlog, tmp_path, code, words):
    mine = tmp_path / "mine.py"
    mine.write_text(code)
    done = attlog("check-estimator", mine)
    assert done.code == 2
    assert words in done.err
    assert "Traceback" not in done.err


@pytest.mark.slow
def test_an_endless_step_ends_the_checks_with_75(attlog, tmp_path, monkeypatch):
    mine = tmp_path / "mine.py"
    mine.write_text("def run(t, gyr, acc, mag, aids, params):\n    while True: pass\n")
    monkeypatch.setenv("ATTLOG_FILTER_TIMEOUT", "1.5")
    done = attlog("check-estimator", mine)
    assert done.code == 75
    assert "took longer than 1.5 s" in done.err
    assert done.out.count("FAIL") <= 2, "the others are not tried"


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda path: path.mkdir(), "is a folder"),
        (os.mkfifo, "is no regular file"),
        (lambda path: path.symlink_to(path.name), "cannot be read (Too many levels"),
        (lambda path: path.write_bytes(b""), "neither start and step nor run"),
        (lambda path: path.write_bytes(b"a\0b"), "null bytes"),
        (lambda path: path.write_bytes(b'x = "\xe9"'), "line 1: (unicode error)"),
        (lambda path: None, "no such estimator file"),
    ],
    ids=["folder", "pipe", "loop", "empty", "binary", "latin", "missing"],
)
def test_what_is_no_filter_file_is_2_and_told(attlog, tmp_path, make, words):
    make(tmp_path / "mine.py")
    done = attlog("estimators", tmp_path / "mine.py")
    assert (done.code, words in done.err) == (2, True), done.err


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root reads everything")
def test_a_file_without_permission_is_2_and_told(attlog, tmp_path):
    (tmp_path / "mine.py").write_text("")
    (tmp_path / "mine.py").chmod(0)
    done = attlog("check-estimator", tmp_path / "mine.py")
    assert (done.code, "cannot be read (Permission denied)" in done.err) == (2, True)
