"""Files of attlog are known by their content, one kind each; nobody else's file is."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest

from attlog.core import own_files
from attlog.core.errors import OutputError
from attlog.core.files import staging_folder, write_all_atomic, write_atomic
from attlog.core.own_files import DATA, PARAMETERS, REPORT, TABLE, FileKind, grown_from, log_of, require_replaceable
from tests.conftest import SAMPLES

KINDS = {name: kind for name, kind in vars(own_files).items() if isinstance(kind, FileKind) and name != "ANY_FILE"}
ONE, OTHER = "a" * 64, "b" * 64
HEAD = (
    '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">\n'
    '<meta http-equiv="Content-Security-Policy" content="default-src &#39;none&#39;">\n<title>'
)
# Beginnings of files as versions 0.15.0 to 0.20.0 wrote them, by name and kind.
WRITTEN = {
    "a.html": ("REPORT", f"{HEAD}a.ulg · attitude report</title>"),
    "a.json": ("REPORT", '{"schema":"attlog-result/7","log":{"sha256":"' + ONE + '"}}'),
    "index.html": ("INDEX", f"{HEAD}out · attitude of 1,200 logs</title>"),
    "results.csv": ("RESULTS", "log,report,sha256,date_utc,vehicle\n"),
    "record.json": ("RECORD", '{"schema":"attlog-record/1","log":"a"}'),
    "batch.json": ("RECORD", '{\n "schema": "attlog-batch/1",\n'),
    "compare.html": ("COMPARISON", f"{HEAD}kp 0.3, kp 0.6 · attitude comparison</title>"),
    "compare.json": ("COMPARISON", '{"attlog":{"version":"0.20.0"},"command":"","configurations":[]}'),
    "compare.csv": ("COMPARISON", "metric,window,unit,scale,log,configuration,value\n"),
    "diff.html": ("DIFFERENCE", f"{HEAD}old and new · what changed</title>"),
    "diff.json": ("DIFFERENCE", '{\n "schema": "attlog-diff/2"}'),
    "diff.md": ("DIFFERENCE", "### a.json\n\nthe same log: 0 of 128 numbers beyond tolerance\n"),
    "alone.md": ("DIFFERENCE", "- h.bin.json: only in NEW\n"),
    "sweep.html": ("SWEEP", f"{HEAD}mahony: 2 settings on 1 log</title>"),
    "sweep.json": ("SWEEP", '{\n "schema": "attlog-sweep/3"}'),
    "sweep.csv": ("SWEEP", "setting,kp,log,metric,window,unit,value,low95\n"),
    "tune.html": ("TUNING", f"{HEAD}mahony: gains from 3 logs</title>"),
    "tune.json": ("TUNING", '{\n "schema": "attlog-tune/2"}'),
    "paper.html": ("PAPER", f"{HEAD}lyu: a paper run again · attlog</title>"),
    "paper.json": ("PAPER", '{\n "key": "lyu",\n "title": "Improved",\n "citation": "Lyu"}'),
    "t.csv": ("TABLE", "log,date,vehicle,firmware,sha256,onboard\n"),
    "by.csv": ("TABLE", "firmware,logs,onboard n,onboard q25,onboard median,onboard q75\n"),
    "t.md": ("TABLE", "| log | date | gyro |\n| --- |\n| a | b | 1 |\n| 75 % |  | 1 |\n| logs |  | 2 |\n"),
    "by.md": ("TABLE", "| firmware | logs | gyro |\n"),
    "t.tex": ("TABLE", "\\begin{tabular}{lrr}\n\\toprule\nlog & date & gyro \\\\\n"),
    "t.txt": ("TABLE", "tilt_rmse_deg, airborne, in °\nlog     date   gyro\n"),
    "a.param": ("PARAMETERS", "# attlog 0.20.0: what to set, found in a.bin (ArduPilot)\n"),
    "j.xml": ("JUNIT", '<?xml version="1.0" encoding="UTF-8"?>\n<testsuites name="attlog">\n'),
    "s.md": ("SUMMARY", "## ✅ attlog: 2 logs, no gate failed\n"),
    "failed.md": ("SUMMARY", "## ❌ attlog: 1 of 2 logs failed\n"),
    "a_tilt.svg": ("FIGURES", '<svg class="main-svg" width="87.84mm"><defs id="defs-tilt-">'),
    "h.bin": ("SIMULATED_LOG", "\xa3\x95...attlog 0.20.0 simulated this flight, seed 0"),
    "h.tlog": ("SIMULATED_LOG", "12345678\xfe...attlog 0.20.0 simulated this flight, seed 0"),
    "h.ulg": ("SIMULATED_LOG", "ULog\x01\x12\x35\x01....char[11] ver_hwSITL_ATTLOG"),
    "h.mcap": ("SIMULATED_LOG", "\x89MCAP0\r\n\x01\x12\0\0\0\0\0\0\0\x04\0\0\0ros2\x06\0\0\0attlog"),
}
# What people have under such names.
THEIRS = {
    "a.html": "<!doctype html><html><head><title>My flight · attitude report</title>",
    "a.json": '{"waypoints": [], "note": "from attlog-result/7"}',
    "index.html": '<!doctype html>\n<html lang="en"><head><title>Our club</title>',
    "t.csv": "log,date,pilot\n",
    "t.md": "| log | date | pilot |\n| --- | --- | --- |\n| a | b | me |\n",
    "s.md": "## What attlog: said\n",
    "a.param": "# my tuning\nATC_RAT_RLL_P,0.135\n",
    "j.xml": '<?xml version="1.0"?>\n<testsuites name="pytest">\n',
    "a_tilt.svg": '<svg class="main-svg" width="87.84mm"><defs id="defs-a1b2c3">',
    "notes.txt": "attlog 0.20.0 simulated this flight, seed 0\n",
    "x.csv": "time_s,roll\n0,1\n",
}


@pytest.mark.parametrize("name", WRITTEN)
def test_a_file_of_any_version_is_of_one_kind(tmp_path: Path, name: str) -> None:
    kind, text = WRITTEN[name]
    path = tmp_path / name
    path.write_bytes(text.encode("latin-1" if kind == "SIMULATED_LOG" else "utf-8"))
    assert [own for own, each in KINDS.items() if each.includes(path)] == [kind]
    require_replaceable(path, KINDS[kind])
    for own, each in KINDS.items():
        if own != kind:
            with pytest.raises(OutputError, match="exists and is not"):
                require_replaceable(path, each)


@pytest.mark.parametrize("name", THEIRS)
def test_a_file_of_others_is_of_none(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(THEIRS[name], encoding="utf-8")
    assert not [own for own, each in KINDS.items() if each.includes(path)]


@pytest.mark.parametrize("log", sorted(path.name for path in SAMPLES.iterdir()))
def test_no_flight_log_is_of_any_kind(log: str) -> None:
    assert not [own for own, each in KINDS.items() if each.includes(SAMPLES / log)]


def test_nothing_is_replaced_by_a_writer_that_names_no_kind(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text(WRITTEN["a.json"][1])
    with pytest.raises(OutputError, match="exists, so it is not replaced"):
        write_atomic(path, "new")
    with pytest.raises(OutputError, match="exists, so it is not replaced"), staging_folder(tmp_path) as stage:
        (stage / "a.json").write_text("new")
    write_atomic(path, "new", REPORT)
    write_atomic(path, "new")  # the same content: nothing is lost
    (tmp_path / "empty").touch()
    write_atomic(tmp_path / "empty", "new")


def staged(folder: Path, *names: str) -> None:
    """Write reports of these names by way of a stage."""
    with staging_folder(folder, REPORT) as stage:
        for name in names:
            (stage / name).write_text("new")


def test_of_several_files_none_is_replaced_where_one_is_of_others(tmp_path: Path) -> None:
    own, theirs = tmp_path / "a.html", tmp_path / "a.json"
    own.write_text(WRITTEN["a.html"][1])
    theirs.write_text(THEIRS["a.json"])
    with pytest.raises(OutputError, match=r"a\.json: exists and is not a report of attlog"):
        write_all_atomic({own: "new", theirs: "new"}, REPORT)
    with pytest.raises(OutputError, match=r"a\.json: exists"):
        staged(tmp_path, own.name, theirs.name)
    assert (own.read_text(), theirs.read_text()) == (WRITTEN["a.html"][1], THEIRS["a.json"])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.html", "a.json"]


def test_a_file_about_another_log_stays(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text(WRITTEN["a.json"][1])
    assert log_of(path) == ONE
    require_replaceable(path, REPORT.of(ONE))
    with pytest.raises(OutputError, match="is a report of another log"):
        require_replaceable(path, REPORT.of(OTHER))
    old = tmp_path / "a.param"  # named no log before 0.21
    old.write_text(WRITTEN["a.param"][1])
    require_replaceable(old, PARAMETERS.of(OTHER))


def test_a_log_of_which_more_has_come_is_the_same_log(tmp_path: Path) -> None:
    log, begun = tmp_path / "a.tlog", b"first part"
    earlier = {"sha256": hashlib.sha256(begun).hexdigest(), "size": len(begun)}
    log.write_bytes(begun + b" and more")
    assert grown_from(log, earlier) == earlier["sha256"]
    log.write_bytes(b"FIRST part and more")
    assert grown_from(log, earlier) == ""
    log.write_bytes(begun[:5])
    assert grown_from(log, earlier) == ""


def test_a_table_is_known_by_the_json_beside_it(tmp_path: Path) -> None:
    table, about = tmp_path / "x.csv", tmp_path / "x.csv.json"
    table.write_text("time_s,GyrX\n0,1\n")
    assert not DATA.includes(table)
    document = dict.fromkeys(("log", "attlog", "frame", "table"), "") | {"sha256": ONE, "units": {"GyrX": "rad/s"}}
    about.write_text(json.dumps(document))
    assert DATA.includes(table)
    assert DATA.includes(about)
    assert log_of(table) == ONE
    table.write_text("time_s,lap\n0,1\n")  # another table under its name
    assert not DATA.includes(table)
    about.write_text('{"about": "my laps"}')
    assert not DATA.includes(about)


def test_a_link_is_as_good_as_the_file_it_leads_to(tmp_path: Path) -> None:
    link = tmp_path / "t.csv"
    link.symlink_to(tmp_path / "gone")
    with pytest.raises(OutputError):
        require_replaceable(link, TABLE)
