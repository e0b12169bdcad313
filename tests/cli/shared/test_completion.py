"""What the shell is offered after TAB."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from attlog.cli.shared import completion
from attlog.estimators import get, names
from tests.conftest import SAMPLES, few


def offered(line: str) -> list[str]:
    """What bash would be offered for the last word of a line."""
    words = line.split(" ")
    env = {**os.environ, "_ATTLOG_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    code = "from attlog.cli import app; app(prog_name='attlog')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env)
    return done.stdout.split()


@pytest.mark.parametrize(
    ("line", "expected"),
    few(
        [
            ("attlog analyze --window ho", ["hover"]),
            ("attlog analyze --estimators gyro,vq", ["gyro,vqf"]),
            ("attlog estimators madg", ["madgwick"]),
            (f"attlog extract {SAMPLES / 'copter_yaw_turns.bin'} ATT", ["ATT"]),
        ],
        1,
    ),
)
def test_the_shell_is_offered_names(line: str, expected: list[str]) -> None:
    assert offered(line) == expected


def test_presets_stand_behind_their_filter() -> None:
    assert completion.rows("gyro,mahony@") == [f"gyro,mahony@{preset}" for preset in get("mahony").presets]
    assert completion.rows("nope@") == []
    assert set(completion.rows("")) == {"default", "all", *names()}
