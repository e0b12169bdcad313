"""How a command begins and ends: what it costs beside its work."""

from __future__ import annotations

import subprocess
import sys


def test_python_does_not_look_through_all_objects_once_more_when_a_command_has_ended() -> None:
    code = (
        "import gc, sys\n"
        "from attlog.cli import main\n"
        "sys.argv = ['attlog', 'schema']\n"
        "try:\n    main()\nexcept SystemExit as end:\n    assert not end.code\n"
        "print(len(gc.get_objects()), gc.get_freeze_count(), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    looked_at, left_alone = map(int, done.stderr.split())
    assert looked_at < 1000 < 10_000 < left_alone
