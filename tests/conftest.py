"""Where the logs are (``sample_logs``, and the corpus that ATTLOG_CORPUS names), and a way to run commands."""

from __future__ import annotations

import functools
import os
import signal
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from _pytest.mark import ParameterSet
from hypothesis import HealthCheck, settings

settings.register_profile("shared", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("shared")  # machines that others use are slow now and then
os.environ["ATTLOG_RAISE"] = "1"  # what the last barrier of attlog/barrier.py catches is a fault in tests
ROOT = Path(__file__).resolve().parent.parent
SAMPLES = ROOT / "sample_logs"


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile what is missing once, before several workers start and each of them does."""
    if getattr(session.config.option, "numprocesses", None):
        from attlog.core.jit import build

        build.prepare(build.all_names(), lambda made, of: print(f"compiled {made} of {of} loops", flush=True))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Whatever reads the corpus is slow: ``make test`` is the same with and without one."""
    root = corpus_root()
    for item in items:
        values = item.callspec.params.values() if hasattr(item, "callspec") else ()
        read = root is not None and any(isinstance(v, Path) and v.is_relative_to(root) for v in values)
        if read or "corpus" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.slow)


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Tests marked ``rights`` skip for a user who may do everything; ATTLOG_REQUIRE_RIGHTS makes that a failure."""
    if item.get_closest_marker("rights") is None or not may_do_everything():
        return
    if os.environ.get("ATTLOG_REQUIRE_RIGHTS"):
        pytest.fail("this user may read and write everything")
    pytest.skip("this user may read and write everything; make test-rights as another user")


@functools.cache
def may_do_everything() -> bool:
    """Whether the system lets this user read a file that nobody may read."""
    with tempfile.NamedTemporaryFile() as file:
        os.chmod(file.name, 0)
        return os.access(file.name, os.R_OK)


def corpus_root() -> Path | None:
    """The corpus folder, None where the tests have to do without."""
    named = os.environ.get("ATTLOG_CORPUS")
    return Path(named) if named and Path(named).is_dir() else None


def corpus_logs(*suffixes: str) -> list[Path]:
    """Every flight log in hand (samples and corpus), of the given suffixes or all; for parametrize."""
    found = sorted(p for p in SAMPLES.glob("*") if p.suffix != ".md")
    root = corpus_root()
    if root is not None:
        found += sorted(p for folder in ("logs", "sitl/px4", "sitl/ardupilot") for p in (root / folder).glob("*"))
    found = [p for p in found if p.suffix.lower() in (".ulg", ".bin", ".tlog", ".log", ".mavlink")]
    return [p for p in found if not suffixes or p.suffix.lower() in suffixes]


def few(cases: Iterable[Any], kept: int) -> list[Any]:
    """Cases for parametrize of which the first ``kept`` run with ``make test`` and all with ``make test-all``."""
    found = [c if isinstance(c, ParameterSet) else pytest.param(*(c if isinstance(c, tuple) else (c,))) for c in cases]
    return [c if k < kept else c._replace(marks=[*c.marks, pytest.mark.slow]) for k, c in enumerate(found)]


@pytest.fixture(scope="session")
def corpus() -> Path:
    """The corpus folder; the test skips where ATTLOG_CORPUS does not name one."""
    root = corpus_root()
    if root is None:
        pytest.skip("ATTLOG_CORPUS does not name a folder with logs")
    return root


@pytest.fixture(scope="session")
def samples() -> Path:
    """The committed sample logs."""
    return SAMPLES


@dataclass
class Done:
    """What a command left behind."""

    code: int
    out: str
    err: str


@pytest.fixture
def attlog(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Done]:
    """``attlog("info", path)`` -> exit code, standard output, standard error."""

    from attlog.cli import main

    def run(*args: object) -> Done:
        monkeypatch.setattr(sys, "argv", ["attlog", *map(str, args)])
        monkeypatch.setenv("NO_COLOR", "1")
        capsys.readouterr()
        try:
            main()
            code = 0
        except SystemExit as stop:
            code = int(stop.code or 0)
        captured = capsys.readouterr()
        return Done(code, captured.out, captured.err)

    return run


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Signals end this process and its children as from a terminal, also where pytest was started to ignore them."""
    numbers = [getattr(signal, name) for name in ("SIGINT", "SIGHUP") if hasattr(signal, name)]
    ignored = [number for number in numbers if signal.getsignal(number) is signal.SIG_IGN]
    for number in ignored:
        signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
    yield
    for number in ignored:
        signal.signal(number, signal.SIG_IGN)


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """One Chromium for all tests of a worker: playwright runs once in a process."""
    from tests.report.browser import chromium

    with chromium() as running:
        yield running


@pytest.fixture
def visit(browser: Any) -> Iterator[Callable[..., Any]]:
    """Opens pages and closes them after the test."""
    from tests.report.browser import Visit

    opened = []

    def open_page(path: Path | str, **options: Any) -> Any:
        opened.append(Visit(browser, path, **options))
        return opened[-1]

    yield open_page
    for page in opened:
        page.close()
