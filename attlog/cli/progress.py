"""Progress of a command on standard error: the stage of one log, a bar over many."""

from __future__ import annotations

import logging
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from attlog.cli.printing import GrowingText, terminal, to_stderr

if TYPE_CHECKING:
    from attlog.batch.job import Job, Record
    from attlog.batch.sources import Source
    from attlog.result import Result

# Loggers of stages of an analysis, of filters that are compiled, and of the result as far as it is known.
STAGES, COMPILING, KNOWN = "attlog.stages", "attlog.compiling", "attlog.known"


class StageHandler(logging.Handler):
    """Write compiled filters to standard error as lines, stages as one line that is overwritten, or as ``lines``.

    ``before``: start of every stage (``[2/5] flight.ulg: ``). ``compiling``: write compiled filters.
    """

    def __init__(self, stages: bool, lines: bool = False, compiling: bool = True) -> None:
        super().__init__(logging.INFO)
        self.stages, self.lines, self._compiling = stages, lines, compiling
        self.before = ""
        self._text = ""
        self._width = 0
        self._shown = threading.RLock()

    def emit(self, record: logging.LogRecord) -> None:
        if record.name == COMPILING:
            if self._compiling:
                self.clear()
                to_stderr(f"attlog: {record.getMessage()}")
            return
        self._text = f"{self.before}{record.getMessage()}"
        if self.stages:
            self.show(f"{self._text} ...")
        elif self.lines:
            to_stderr(f"attlog: {self._text}")

    def show(self, text: str) -> None:
        """Show a text in place of the last one, which blanks overwrite, without escape sequences."""
        import shutil

        from attlog.words.text import for_terminal

        with self._shown:
            self._text = text.removesuffix(" ...")
            text = for_terminal(text)[-(shutil.get_terminal_size().columns - 1) :]
            print("\r" + text.ljust(self._width), end="", file=sys.stderr, flush=True)
            self._width = len(text)

    def clear(self) -> None:
        """Blank the line of stages."""
        with self._shown:
            if self._width:
                print("\r" + " " * self._width + "\r", end="", file=sys.stderr, flush=True)
                self._width = 0

    def tell_time(self, seconds: float) -> None:
        """Show how long the command has run: in the line of stages if one is shown, else as a line."""
        with self._shown:
            if self.stages:
                if self._width:
                    text = self._text
                    self.show(f"{text}, {seconds:.0f} s ...")
                    self._text = text
            else:
                write_line(f"attlog: {self._text or 'at work'}, {seconds:.0f} s")


# Seconds without a sign of life. A terminal is told the time each second then, a file after 5, 10, 20, 40 ... s.
SILENCE_S = 5.0
SECOND_S = 1.0


def write_line(text: str) -> None:
    """Write a line to standard error without its buffer, which a fork might copy half written."""
    from attlog.words.text import for_terminal

    with suppress(OSError, ValueError):
        os.write(sys.stderr.fileno(), f"{for_terminal(text)}\n".encode("utf-8", "backslashreplace"))


@contextmanager
def signs_of_life(tell: Callable[[float], None], *, terminal: bool) -> Iterator[None]:
    """Call ``tell`` with the seconds since the beginning, from a thread, while the block takes long."""
    ended, begin = threading.Event(), time.monotonic()

    def run() -> None:
        wait = SILENCE_S
        while not ended.wait(wait):
            seconds = time.monotonic() - begin
            tell(seconds)
            wait = SECOND_S if terminal else seconds

    try:
        sys.stderr.fileno()
    except (AttributeError, OSError, ValueError):  # replaced, as by a notebook
        yield
        return
    thread = threading.Thread(target=run, name="attlog-progress", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


@contextmanager
def progress(quiet: bool, verbose: bool, lines: bool = False) -> Iterator[StageHandler]:
    """Show stages on a terminal, and compiled filters also with ``verbose``.

    ``lines``: with ``verbose`` every stage is a line if there is no terminal. What takes long shows its time.
    """
    terminal = sys.stderr.isatty() and not quiet
    shown = StageHandler(stages=terminal, lines=lines and verbose, compiling=terminal or verbose)
    loggers = [] if quiet and not verbose else [logging.getLogger(name) for name in (STAGES, COMPILING)]
    for logger in loggers:
        logger.addHandler(shown)
        logger.setLevel(logging.INFO)
        logger.propagate = False
    try:
        with nullcontext() if quiet else signs_of_life(shown.tell_time, terminal=terminal):
            yield shown
    finally:
        shown.clear()
        for logger in loggers:
            logger.removeHandler(shown)
            logger.setLevel(logging.NOTSET)
            logger.propagate = True


class FirstLinesHandler(logging.Handler):
    """Print title and headline of a log as soon as each is known."""

    def __init__(self, text: GrowingText, before: Callable[[], None]) -> None:
        super().__init__(logging.INFO)
        self._text, self._before = text, before

    def emit(self, record: logging.LogRecord) -> None:
        from attlog.cli.tables import first_lines

        result: Result = record.__dict__["result"]
        self._before()
        with suppress(OSError):  # the last lines end the command in the same way, after the report is written
            self._text.show(first_lines(result, self._text.width))


@contextmanager
def first_lines_shown(text: GrowingText | None, before: Callable[[], None]) -> Iterator[None]:
    """Begin a text with the title and headline of the log that the block works on; ``before``: called before."""
    if text is None:
        yield
        return
    logger, handler = logging.getLogger(KNOWN), FirstLinesHandler(text, before)
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    logger.propagate = False
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(logging.NOTSET)
        logger.propagate = True


# What flew, by the endings of names of logs: a guess, which a wrong name costs compiling at the first run.
FLOWN_BY_ENDING = {".ulg": "px4_ekf2", ".bin": "ap_ekf3", ".log": "ap_ekf3"}


def compile_first(rows: Sequence[str], logs: Sequence[Source], quiet: bool) -> None:
    """Compile the loops of these estimators before their first run on ``logs``, if the package does not hold them.

    The filter that flew is run again beside the sets ``default`` and ``all``. Missing logs need no loops.
    """
    from attlog.core.jit import build, jit_wanted, store

    endings = [log.name.lower() for log in logs if not log.is_missing]
    if not endings:
        return
    sets = {"default", "all"} & {item for row in rows for item in row.split(",")}
    flown = {name for ending, name in FLOWN_BY_ENDING.items() if sets and any(ending in log for log in endings)}
    names = build.flown_names(flown) if store.is_shipped() else build.names_for([*rows, *flown])
    if names and jit_wanted():
        stage = logging.getLogger(STAGES)
        with progress(quiet, verbose=not quiet):
            build.prepare(names, lambda made, of: stage.info("compiled %d of %d loops", made, of))


# Bytes of log that take as long as the fixed cost of a log.
PER_LOG_BYTES = 300_000
# Characters of a log's name beside the bar.
NAME_COLUMNS = 40


class Bar:
    """Progress bar of many logs on standard error, if that is a terminal and not ``quiet``.

    ``verbose``: name compiled filters without a terminal too.
    """

    def __init__(self, quiet: bool = False, verbose: bool = False) -> None:
        self._shown = sys.stderr.isatty() and not quiet
        self._quiet = quiet
        self._life = ExitStack()
        self._compiling = (self._shown or verbose) and not quiet
        self._progress: Any = None
        self._compiled: set[str] = set()
        self._lock = threading.RLock()
        self._weights: dict[str, float] = {}
        self._all = self._done = self._failed = self._mine = 0
        self._weight = 0.0
        self._started = time.monotonic()

    @property
    def is_shown(self) -> bool:
        """True if the bar is visible."""
        return self._shown

    def __enter__(self) -> Bar:
        if not (self._shown or self._quiet):
            self._life.enter_context(signs_of_life(self._tell_time, terminal=False))
        return self

    def _tell_time(self, seconds: float) -> None:
        from attlog.words.numbers import counted

        write_line(f"attlog: {self._done} of {counted(self._all, 'log')}{self._more()}, {seconds:.0f} s")

    def __exit__(self, *_: object) -> None:
        self._life.close()
        if self._progress is not None:
            self._progress.stop()

    def planned(self, jobs: Sequence[Job]) -> None:
        """Start the bar."""
        self._weights = {job.name: _weight(job) for job in jobs}
        self._all, self._started = len(jobs), time.monotonic()
        if not self._shown:
            return
        from rich.progress import BarColumn, Progress, TextColumn

        self._progress = Progress(
            BarColumn(30),
            TextColumn("{task.completed}/{task.total} logs{task.fields[more]}", markup=False),
            TextColumn("{task.fields[now]}", markup=False),
            console=terminal(stderr=True),
            transient=True,
            redirect_stdout=False,
            redirect_stderr=False,
            refresh_per_second=4,
        )
        self._task = self._progress.add_task("", total=len(jobs), more="", now="")
        self._progress.start()

    def stage(self, job: Job, news: dict[str, Any]) -> None:
        """Show the stage of a log, and a compiled filter once. Called from any thread."""
        from attlog.words.text import for_terminal

        compiling = news.get("compiling", "")
        with self._lock:
            if compiling and self._compiling and compiling not in self._compiled:
                self._compiled.add(compiling)
                with self.aside():
                    to_stderr(f"attlog: {compiling}")
            if self._progress is not None and "stage" in news:
                self._progress.update(self._task, now=for_terminal(f"{job.name[-NAME_COLUMNS:]}: {news['stage']}"))

    def advance(self, record: Record) -> None:
        """Count a log that is done or failed."""
        self._done += 1
        self._failed += not record.done
        weight = self._weights.pop(record.name, 0.0)
        if not record.again:
            self._mine += 1
            self._weight += weight
        if self._progress is not None:
            self._progress.update(self._task, completed=self._done, more=self._more(), now="")

    def _more(self) -> str:
        """Return failures, speed and time left, of logs that were not done before."""
        seconds = time.monotonic() - self._started
        text = f", {self._failed} failed" if self._failed else ""
        if self._mine and seconds > 0:
            text += f"  {speed(self._mine / seconds)}"
        if self._weight and self._done < self._all:
            left = sum(self._weights.values()) * seconds / self._weight
            text += f"  {left // 3600:.0f}:{left // 60 % 60:02.0f}:{left % 60:02.0f} left"
        return text

    @contextmanager
    def aside(self) -> Iterator[None]:
        """Hide the bar while the block prints."""
        if self._progress is None:
            yield
            return
        with self._lock:
            self._progress.stop()
            try:
                yield
            finally:
                self._progress.start()


def speed(per_second: float) -> str:
    """Return logs per second, or per minute below 1."""
    return f"{per_second:.1f} logs/s" if per_second >= 1 else f"{per_second * 60:.1f} logs/min"


def _weight(job: Job) -> float:
    """Return the cost of a log in bytes."""
    try:
        return PER_LOG_BYTES + float(Path(job.source.place).stat().st_size) * (not job.source.member)
    except OSError:
        return PER_LOG_BYTES
