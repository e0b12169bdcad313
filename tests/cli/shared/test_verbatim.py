"""Words of a command line that no validator looks at mean the same as with Typer's own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any

import pytest
import typer
from typer.testing import CliRunner

from attlog.cli.shared.arguments import Plain
from attlog.cli.shared.common import finite

SEEN: list[dict[str, Any]] = []


def _told(**values: Any) -> None:
    SEEN.append(values)


def command(
    logs: Annotated[list[Path], typer.Argument(readable=False)],
    places: Annotated[list[str] | None, typer.Option("--place")] = None,
    output: Annotated[Path, typer.Option("-o")] = Path("reports"),
    config: Annotated[Path | None, typer.Option()] = None,
    window: str | None = None,
    jobs: Annotated[int, typer.Option("-j", min=1)] = 1,
    score: Annotated[float | None, typer.Option(callback=finite)] = None,
    quiet: Annotated[bool, typer.Option("-q")] = False,
    strict: Annotated[bool | None, typer.Option("--strict/--no-strict")] = None,
    verbose: Annotated[int, typer.Option("-v", count=True)] = 0,
) -> None:
    _told(**locals())


def run(words: list[str], cls: Any) -> tuple[int, Any, str]:
    """Exit code, what the command got, what was said."""
    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    app.command(cls=cls)(command)
    SEEN.clear()
    done = CliRunner().invoke(app, words)
    return done.exit_code, [{k: (v, type(v)) for k, v in seen.items()} for seen in SEEN], done.output


@pytest.mark.parametrize(
    "words",
    [
        ["a.ulg"],
        ["a.ulg", "b\udcff.ulg", "-o", "", "--window", ""],
        ["a.ulg", "--place", "x", "--place", "y", "-o", "out", "--config", __file__, "--window", "3:4"],
        ["a.ulg", "-j", "3", "--score", "1.5", "-q", "-vv", "--no-strict"],
        ["a.ulg", "-j", "0"],
        ["a.ulg", "-j", "x"],
        ["a.ulg", "--score", "nan"],
        ["--window", "3"],
        [],
        ["--help"],
    ],
    ids=" ".join,
)
def test_a_command_gets_what_typer_would_give_it(words: list[str]) -> None:
    assert run(words, Plain) == run(words, None)


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="needs a file that may not be read")
def test_a_path_that_may_not_be_read_is_left_to_typer(tmp_path: Path) -> None:
    closed = tmp_path / "closed.toml"
    closed.write_text("")
    closed.chmod(0)
    words = ["a.ulg", "--config", str(closed)]
    assert run(words, Plain) == run(words, None)
    assert run(words, Plain)[0] == 2


def test_text_and_paths_ask_no_validator() -> None:
    """Typer imports pydantic for the first value that it looks at."""
    code = (
        "import sys\nfrom tests.cli.shared.test_verbatim import run\nfrom attlog.cli.shared.arguments import Plain\n"
        "assert run(['a.ulg', '-o', 'out', '--window', '3:4', '-q', '-v'], Plain)[0] == 0\n"
        "print('pydantic' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
