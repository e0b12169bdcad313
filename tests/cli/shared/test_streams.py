"""Standard output that is full, that nobody reads, that shows no signs: documented codes, no traceback."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import SAMPLES, few

LOG = SAMPLES / "copter_yaw_turns.bin"
COMMANDS = {
    "help": ["--help"],
    "schema": ["schema"],
    "estimators": ["estimators"],
    "one estimator": ["estimators", "vqf"],
    "info": ["info", LOG],
    "info json": ["info", LOG, "--json"],
    "extract": ["extract", LOG, "ATT", "-o", "-"],
    "analyze": ["analyze", LOG, "--estimators", "gyro", "-o", "OUT"],
}


def start(arguments: list[str | Path | bytes], tmp_path: Path, **how: object) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "attlog", *(str(tmp_path / "out") if a == "OUT" else a for a in arguments)]
    return subprocess.run(command, stderr=subprocess.PIPE, **how)  # type: ignore[call-overload, no-any-return]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no full device here")
@pytest.mark.parametrize("arguments", few(COMMANDS.values(), 2), ids=COMMANDS.keys())
def test_a_full_disk_behind_standard_output_is_73(tmp_path: Path, arguments: list[str | Path | bytes]) -> None:
    with open("/dev/full", "wb") as full:
        done = start(arguments, tmp_path, stdout=full)
    assert (done.returncode, done.stderr.count(b"\n")) == (73, 1), done.stderr
    assert b"standard output cannot be written" in done.stderr


@pytest.mark.parametrize("arguments", few([["schema"], ["info", LOG]], 1), ids=["schema", "info"])
def test_a_reader_that_goes_away_hears_nothing(tmp_path: Path, arguments: list[str | Path | bytes]) -> None:
    ours, theirs = os.pipe()
    os.close(ours)
    done = start(arguments, tmp_path, stdout=theirs)
    os.close(theirs)
    assert (done.returncode, done.stderr) == (73, b"")


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp1252"])
@pytest.mark.parametrize("arguments", few(COMMANDS.values(), 1), ids=COMMANDS.keys())
def test_every_command_works_where_signs_cannot_be_shown(
    tmp_path: Path, arguments: list[str | Path | bytes], encoding: str
) -> None:
    environment = {**os.environ, "PYTHONIOENCODING": encoding, "NO_COLOR": "1"}
    done = start(arguments, tmp_path, stdout=subprocess.PIPE, env=environment)
    assert done.returncode == 0, done.stderr[-500:]
    text = done.stdout.decode(encoding)
    assert len(text) > 100
    assert "\x1b" not in text
    assert "\\u" not in text.replace("\\udc", "") or arguments[-1] == "--json"
    assert [line for line in text.splitlines() if line != line.rstrip()] == []


@pytest.mark.skipif(sys.platform == "darwin", reason="its file systems keep UTF-8 names only")
@pytest.mark.parametrize(
    "arguments", few([["info"], ["info", "--json"], ["extract", "ATT", "-o", "OUT"], ["extract", "ATT", "-o", "-"]], 1)
)
def test_a_file_name_that_is_not_utf8_works(tmp_path: Path, arguments: list[str]) -> None:
    log = os.path.join(os.fsencode(tmp_path), b"a\xff.bin")
    os.symlink(os.fsencode(LOG), log)
    done = start([arguments[0], log, *arguments[1:]], tmp_path, stdout=subprocess.PIPE)
    assert done.returncode == 0, done.stderr[-500:]
    if arguments == ["info"]:
        assert done.stdout.startswith(b"a\\xff.bin")
