"""Filters from files on the command line: reports are written whatever the files do, standard output stays clean."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

RUN = '''"""One."""
import numpy as np
from attlog.estimators import Estimate
{top}
def run(t, gyr, acc, mag, aids, params):
    {body}
    return Estimate(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)))
'''
FILES = {
    "raises": ("", "raise ValueError('bad run')"),
    "loops": ("", "while True: pass"),
    "prints": ("print('at import')", "print('in run')"),
    "ends": ("import os", "os._exit(0)"),
}


@pytest.mark.slow
def test_a_report_is_written_whatever_filters_from_files_do(samples, tmp_path):
    for name, (top, body) in FILES.items():
        (tmp_path / f"{name}.py").write_text(RUN.format(top=top, body=body))
    filters = ",".join(["gyro", *(str(tmp_path / f"{name}.py") for name in FILES)])
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "attlog",
            "analyze",
            samples / "copter_steps_stabilize.bin",
            "-o",
            tmp_path,
            "--estimators",
            filters,
            "--reference",
            "onboard",
            "--json",
        ],
        capture_output=True,
        text=True,
        env=os.environ | {"ATTLOG_FILTER_TIMEOUT": "6"},
    )
    assert done.returncode == 75, done.stderr[-2000:]
    assert "Traceback" not in done.stderr
    document = json.loads(done.stdout)
    rows = {row["name"]: row for row in document["estimators"]}
    assert rows["gyro"]["status"] != "failed"
    assert (tmp_path / "copter_steps_stabilize.bin.html").stat().st_size > 10_000
    assert "raises.py, line 6: ValueError: bad run" in rows["raises"]["reason"]
    assert "took longer than 6 s" in rows["loops"]["reason"]
    assert "its process ended without an answer" in rows["ends"]["reason"]
    assert rows["prints"]["status"] != "failed"
    assert "at import" in done.stderr
    assert "in run" in done.stderr
    assert {f["kind"] for f in document["findings"]} >= {"estimator_failed", "estimator_timed_out"}


LATER = "calls.append(0); time.sleep(30 if len(calls) == 2 else 0)"


@pytest.mark.slow
def test_compare_ends_with_the_code_of_a_filter_that_took_too_long_when_a_metric_tried_it(samples, tmp_path):
    (tmp_path / "later.py").write_text(RUN.format(top="import time\ncalls = []", body=LATER))
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "attlog",
            "compare",
            samples / "copter_yaw_turns.bin",
            "gyro",
            tmp_path / "later.py",
            "-o",
            tmp_path / "out",
        ],
        capture_output=True,
        text=True,
        env=os.environ | {"ATTLOG_FILTER_TIMEOUT": "3"},
    )
    assert done.returncode == 75, done.stderr[-2000:]
    assert "in a later run" in done.stderr
    assert list((tmp_path / "out").rglob("*.html"))


def test_a_filter_of_an_installed_package_that_crashes_is_a_failed_row(attlog, samples, tmp_path, monkeypatch):
    about = tmp_path / "evil-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: evil\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[attlog.estimators]\nevil = evil_module\n")
    (tmp_path / "evil_module.py").write_text("import os\nos.abort()\n")
    monkeypatch.syspath_prepend(tmp_path)
    log = samples / "copter_yaw_turns.bin"
    done = attlog(
        "analyze", log, "--estimators", "gyro,evil", "--reference", "onboard", "-o", tmp_path / "out", "--json"
    )
    assert done.code == 0, done.err
    rows = {row["name"]: row for row in json.loads(done.out)["estimators"]}
    assert (rows["gyro"]["status"] != "failed", "SIGABRT" in rows["evil"]["reason"]) == (True, True)


@pytest.mark.slow
def test_a_result_runs_no_filter_file_that_only_the_result_names(attlog, samples, tmp_path):
    """Results are sent around; ``--config RESULT.json`` ran whatever file lay where the result said."""
    log, mine = samples / "copter_yaw_turns.bin", tmp_path / "mine.py"
    mine.write_text(RUN.format(top="", body=f"open({str(tmp_path / 'ran')!r}, 'w')"))
    given = ("--reference", "onboard", "-q", "-o", tmp_path)
    assert attlog("analyze", log, "--estimators", f"gyro,{mine}", *given).code == 0
    (tmp_path / "ran").unlink()
    result = tmp_path / "copter_yaw_turns.bin.json"
    done = attlog("analyze", log, "--config", result, *given)
    assert done.code == 2
    assert f"--estimators gyro,{mine}" in done.err
    assert str(result) in done.err
    assert attlog("batch", log, "--config", result, "-o", tmp_path / "b").code == 2
    assert attlog("compare", log, "gyro", "mahony", "--config", result, *given).code == 0  # runs no row of the result
    assert not (tmp_path / "ran").exists()
    assert attlog("analyze", log, "--config", result, "--estimators", f"gyro,{mine}", *given).code == 0
    assert (tmp_path / "ran").exists()
    (tmp_path / "own.toml").write_text(f"estimators = ['gyro', '{mine}']\n")  # a file that the user writes
    assert attlog("analyze", log, "--config", tmp_path / "own.toml", *given).code == 0


@pytest.mark.slow
def test_where_every_filter_failed_the_exit_code_and_a_sentence_say_so(attlog, samples, tmp_path):
    log, bad = samples / "copter_yaw_turns.bin", tmp_path / "bad.py"
    bad.write_text(RUN.format(top="", body="raise ValueError('bad run')"))
    given = ("--reference", "onboard", "-q", "-o", tmp_path)
    done = attlog("analyze", log, "--estimators", bad, *given)
    assert done.code == 2
    assert "no filter ran: bad: " in done.err
    assert "line 6: ValueError: bad run" in done.err
    assert (tmp_path / "copter_yaw_turns.bin.html").exists()
    assert attlog("analyze", log, "--estimators", f"gyro,{bad}", *given).code == 0
    done = attlog("compare", log, bad, f"{bad}:lowpass=20", *given)
    assert done.code == 2
    assert "no configuration ran: " in done.err
    assert attlog("compare", log, "gyro", bad, *given).code == 0


# ``attlog estimators``, ``new`` and ``check-estimator``: from the list to a filter of one's own.


def test_the_list_shows_needs_errors_and_cost_within_100_columns(attlog):
    from attlog.estimators.accuracy import read_accuracy

    lines = attlog("estimators").out.splitlines()
    begin = next(i for i, line in enumerate(lines) if "BROAD °" in line)
    end = lines.index("", begin)
    shown = {line.split()[0]: line for line in lines[begin + 1 : end]}
    known = read_accuracy()["madgwick"]
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


def test_the_template_for_whole_segments_agrees_with_the_filter_it_is(attlog, tmp_path):
    import numpy as np

    import attlog as package
    from attlog.testing import swing

    mine, m = tmp_path / "my_filter.py", swing(3.0)
    assert attlog("new", "--run", mine).code == 0
    wanted = package.estimate("mahony:kp=0.6,ki=0,init=first", *m.sensors)
    assert np.abs(package.estimate(str(mine), *m.sensors).q - wanted.q).max() < 1e-12


@pytest.mark.slow
def test_a_wrong_sign_fails_the_checks_with_1_and_an_endless_step_with_75(attlog, tmp_path, monkeypatch):
    mine = tmp_path / "my_filter.py"
    attlog("new", mine)
    mine.write_text(mine.read_text().replace("state[4] + kp * ex", "state[4] - kp * ex"))
    done = attlog("check-estimator", mine)
    assert done.code == 1
    assert "FAIL  converges from 170 deg" in done.out
    mine.write_text("def run(t, gyr, acc, mag, aids, params):\n    while True: pass\n")
    monkeypatch.setenv("ATTLOG_FILTER_TIMEOUT", "1.5")
    done = attlog("check-estimator", mine)
    assert (done.code, "took longer than 1.5 s" in done.err) == (75, True)
    assert done.out.count("FAIL") <= 2, "the others are not tried"


def test_a_file_that_exists_is_kept(attlog, tmp_path):
    mine = tmp_path / "mine.py"
    mine.write_text("precious")
    assert attlog("new", mine).code == 73
    assert mine.read_text() == "precious"
    assert attlog("new", tmp_path / "mine.txt").code == 2
    assert list(tmp_path.iterdir()) == [mine]


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
        (lambda path: path.write_text("def step(:\n"), "line 1"),
        (lambda path: path.write_text("import nothing_like_this\n"), "nothing_like_this"),
    ],
    ids=["folder", "pipe", "loop", "empty", "binary", "latin", "missing", "syntax", "import"],
)
def test_what_is_no_filter_file_is_2_and_told(attlog, tmp_path, make, words):
    make(tmp_path / "mine.py")
    for command in ("estimators", "check-estimator"):
        done = attlog(command, tmp_path / "mine.py")
        assert (done.code, words in done.err, "Traceback" in done.err) == (2, True, False), done.err


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root reads everything")
def test_a_file_without_permission_is_2_and_told(attlog, tmp_path):
    (tmp_path / "mine.py").write_text("")
    (tmp_path / "mine.py").chmod(0)
    done = attlog("check-estimator", tmp_path / "mine.py")
    assert (done.code, "cannot be read (Permission denied)" in done.err) == (2, True)
