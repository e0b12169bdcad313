"""Every command that writes: twice over works, and a file that is not its own stays, whichever of its files it is."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from attlog.cli import app
from attlog.cli.arguments import COMMANDS
from attlog.report.figures.files import BROWSER_NAMES
from tests.conftest import ROOT, SAMPLES
from tests.reproduce.made import paper

LOG = SAMPLES / "copter_yaw_turns.bin"
GYRO = ("--estimators", "gyro", "--reference", "onboard", "-q")
TWO = ("mahony:kp=0.3", "mahony:kp=0.6")
MINE = b"mine, and nobody else's\n"
BROWSER = pytest.mark.skipif(not any(map(shutil.which, BROWSER_NAMES)), reason="no browser draws figures")
# Commands and their options that write, with words that write small files to the folder OUT.
OUT, RESULT, BATCH = "{out}", "{result}", "{batch}"
WAYS: Mapping[tuple[str, str], tuple[object, ...]] = {
    ("analyze", "--output"): ("analyze", LOG, *GYRO, "-o", OUT),
    ("analyze", "--figures"): ("analyze", LOG, *GYRO, "-o", f"{OUT}/reports", "--figures", OUT),
    ("batch", "--output"): ("batch", LOG, *GYRO, "-o", OUT, "--fresh"),
    ("batch", "--junit"): ("batch", LOG, *GYRO, "-o", f"{OUT}/batch", "--fresh", "--junit", f"{OUT}/j.xml"),
    ("batch", "--summary"): ("batch", LOG, *GYRO, "-o", f"{OUT}/batch", "--fresh", "--summary", f"{OUT}/s.md"),
    ("health", "--output"): ("health", LOG, "-q", "-o", OUT),
    ("extract", "--output"): ("extract", LOG, "GPS", "BAT", "-q", "-o", OUT),
    ("extract", "-o FILE"): ("extract", LOG, "GPS", "-q", "-o", f"{OUT}/gps.csv"),
    ("extract", "-o PARQUET"): ("extract", LOG, "GPS", "-q", "-o", f"{OUT}/gps.parquet"),
    ("compare", "--output"): ("compare", LOG, *TWO, "-q", "-o", OUT),
    ("compare", "--name"): ("compare", LOG, *TWO, "-q", "-o", OUT, "--name", "results"),
    ("diff", "--output"): ("diff", RESULT, RESULT, "-o", OUT),
    ("diff", "-o FILE"): ("diff", RESULT, RESULT, "--json", "-o", f"{OUT}/d.json"),
    ("diff", "-o MARKDOWN"): ("diff", RESULT, RESULT, "--format", "md", "-o", f"{OUT}/d.md"),
    ("sweep", "--output"): ("sweep", LOG, "mahony", "kp=0.3,1", "-q", "-o", OUT),
    ("tune", "--output"): ("tune", LOG, "mahony", "kp=0.2..1", "--reference", "onboard", "-q", "-o", OUT),
    ("reproduce", "--output"): ("reproduce", "lyu", "--seeds", "1", "-q", "-o", OUT),
    **{
        ("table", "--output" if kind == "csv" else kind): ("table", RESULT, "-o", f"{OUT}/t.{kind}")
        for kind in ("csv", "md", "tex", "txt", "parquet")
    },
    **{
        ("simulate", "--output" if kind == "ulg" else kind): (
            *("simulate", "static", "--set", "seconds=2", "-q"),
            *("-o", f"{OUT}/a.{kind}"),
        )
        for kind in ("ulg", "bin", "tlog", "mcap")
    },
    ("simulate", "--seeds"): ("simulate", "static", "--set", "seconds=2", "-q", "--seeds", "1,2", "-o", OUT),
}
FAST = (
    ("analyze", "--output"),
    ("extract", "--output"),
    ("diff", "--output"),
    ("table", "--output"),
    ("health", "--output"),
    ("reproduce", "--output"),
)
# Writes a file that must not exist.
ONCE = ("new", "file")


def test_every_option_that_writes_is_tried_here() -> None:
    """An option that writes says so in its help."""
    group: Any = get_command(app)
    found = set()
    for name in COMMANDS:
        for parameter in group.get_command(None, name).params:
            places = re.search(r"DIR|FILE|PATH|F\.|FOLDER", str(parameter.metavar))
            if places and re.match(r"Write|Save|Store|Put", str(getattr(parameter, "help", ""))):
                found.add((name, max(parameter.opts, key=len)))
    assert found - {ONCE} == {way for way in WAYS if way[1] in ("--output", "--junit", "--summary", "--figures")}


# Modules that open files for writing themselves: in scratch and private folders, or by the rules of core/files.py.
WRITERS = {
    *("batch/ci.py", "batch/cluster.py", "batch/log_file.py", "batch/run.py", "cli/process.py"),
    *("core/files.py", "core/jit/store.py", "report/figures/files.py"),
}


def test_no_other_module_writes_a_file_without_the_rules() -> None:
    opens = re.compile(
        r"\.write_text\(|\.write_bytes\(|open\([^()]*[\"'][wax]b?\+?[\"']|os\.fdopen|\.to_csv\((?!buffer)"
    )
    found = {
        path.relative_to(ROOT / "attlog").as_posix()
        for path in (ROOT / "attlog").rglob("*.py")
        if opens.search(path.read_text(encoding="utf-8"))
    }
    assert found == WRITERS


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result of analyze."""
    from attlog.batch.report_files import analyze_to_files
    from attlog.pipeline.config import Config

    config = Config.build({"estimators": ["gyro"], "reference": "onboard"})
    return analyze_to_files(LOG, config, tmp_path_factory.mktemp("result")).json


def files_of(folder: Path) -> dict[Path, bytes]:
    """Visible files, except those of other options of the same command."""
    found = [path for path in folder.rglob("*") if path.is_file()]
    return {path: path.read_bytes() for path in found if not any(p.startswith(".") for p in path.parts)}


def marked(way: tuple[str, str]) -> Any:
    """Return a way for parametrize: most are slow, and figures need a browser."""
    marks = [*([] if way in FAST else [pytest.mark.slow]), *([BROWSER] if "figures" in way[1] else [])]
    return pytest.param(way, marks=marks, id=" ".join(way))


@pytest.mark.parametrize("way", [*map(marked, WAYS)])
def test_a_command_replaces_its_own_files_and_no_others(
    attlog: Callable[..., Any], tmp_path: Path, result: Path, monkeypatch: pytest.MonkeyPatch, way: tuple[str, str]
) -> None:
    param = "# attlog 0.20.0: what to set, found in a.bin (ArduPilot)\nEK3_ENABLE,1\n"
    monkeypatch.setattr("attlog.health.settings.param_file", lambda log, settings: param)
    # Its experiments take minutes; what is written of them is of interest here.
    monkeypatch.setattr("attlog.reproduce.lyu.paper", lambda options: replace(paper(), key="lyu", seeds=options.seeds))
    out = tmp_path / "out"
    out.mkdir()
    words = [str(word).replace(OUT, str(out)).replace(RESULT, str(result)) for word in WAYS[way]]
    first = attlog(*words)
    assert first.code in (0, 1), first.err
    written = [path for path in files_of(out) if path.parent == out]
    assert written
    again = attlog(*words)
    assert again.code == first.code, again.err
    for path in written if len(written) < 10 else (*written[:2], written[-1]):
        if not path.exists():  # removed by --fresh before the last refusal
            assert attlog(*words).code == first.code
        kept = path.read_bytes()
        for theirs in (MINE, LOG.read_bytes() if path is written[0] else b'{"name": "mine"}'):
            path.write_bytes(theirs)
            before = files_of(out)
            refused = attlog(*words)
            read = "is a flight log and would be overwritten" in refused.err
            assert refused.code == (2 if read else 73), (path, refused.err)
            assert read or "so it is not replaced" in refused.err
            stays = [path] if "--fresh" in words else [p for p in before if p.parent == out]  # the rest was removed
            assert {p: p.read_bytes() for p in stays} == {p: before[p] for p in stays}
        path.write_bytes(kept)
    assert attlog(*words).code == first.code


@pytest.mark.parametrize("command", ["analyze", "extract"])
def test_another_flight_of_the_same_name_takes_no_place(
    attlog: Callable[..., Any], tmp_path: Path, command: str
) -> None:
    words = {"analyze": GYRO, "extract": ("GPS", "-q")}[command]
    logs = [tmp_path / folder / "flight.bin" for folder in "ab"]
    for log, size in zip(logs, (600_000, 500_000), strict=True):
        log.parent.mkdir()
        log.write_bytes(LOG.read_bytes()[:size])
    out = tmp_path / "out"
    assert attlog(command, logs[0], *words, "-o", out).code == 0
    before = files_of(out)
    done = attlog(command, logs[1], *words, "-o", out)
    assert (done.code, "of another log" in done.err) == (73, True), done.err
    assert files_of(out) == before
    logs[0].write_bytes(LOG.read_bytes()[:900_000])  # more of the first has come
    assert attlog(command, logs[0], *words, "-o", out).code == (0 if command == "analyze" else 73)


@pytest.mark.slow
def test_a_run_that_answers_nothing_keeps_the_earlier_answer(attlog: Callable[..., Any], tmp_path: Path) -> None:
    out, broken = tmp_path / "out", tmp_path / "broken.py"
    broken.write_text("NEEDS = {'gyro'}\ndef run(*given, **more):\n    raise ValueError('no')\n")
    assert attlog("analyze", LOG, *GYRO, "-o", out).code == 0
    assert attlog("compare", LOG, *TWO, "-q", "-o", out).code == 0
    before = files_of(out)
    failed = attlog("analyze", LOG, "--estimators", broken, "-q", "-o", out)
    assert (failed.code, "an earlier run" in failed.err) == (2, True), failed.err
    assert attlog("compare", tmp_path / "gone.bin", *TWO, "-q", "-o", out).code == 66
    (tmp_path / "none.bin").write_bytes(b"no log " * 100)
    assert attlog("compare", tmp_path / "none.bin", *TWO, "-q", "-o", out).code == 65
    assert files_of(out) == before
    assert attlog("compare", tmp_path / "none.bin", *TWO, "-q", "-o", tmp_path / "new").code == 65
    assert not (tmp_path / "new").exists()


def test_a_batch_folder_of_a_stranger_leads_to_no_other_file(attlog: Callable[..., Any], tmp_path: Path) -> None:
    out, precious = tmp_path / "out", tmp_path / "precious.json"
    precious.write_bytes(MINE)
    records = out / ".attlog" / "records"
    records.mkdir(parents=True)
    log = str(LOG)
    (out / ".attlog" / "batch.json").write_text(
        json.dumps({"schema": "attlog-batch/1", "names": {log: "../../precious", "b": "b"}})
    )
    record = {"schema": "attlog-record/1", "log": "b", "name": "b", "files": {"../precious.json": [24, ""]}}
    (records / "b.json").write_text(json.dumps(record))
    assert attlog("batch", LOG, *GYRO, "-o", out, "--fresh").code == 0
    assert precious.read_bytes() == MINE
    (out / ".attlog" / "lock").unlink()
    (out / ".attlog" / "lock").symlink_to(precious)
    assert attlog("batch", LOG, *GYRO, "-o", out, "--resume").code == 73
    assert precious.read_bytes() == MINE
