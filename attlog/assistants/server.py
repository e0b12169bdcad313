"""MCP server with the tools of ``attlog mcp``, on standard input and output.

Each call runs in a process of its own with a time limit, so that no log can end the server.
"""

from __future__ import annotations

import json
import re
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Coroutine, Sequence
from contextlib import suppress
from contextvars import ContextVar
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from pydantic import Field

from attlog import __version__
from attlog.assistants import answers
from attlog.assistants.folders import MAX_CHARACTERS, UNTRUSTED, Folders, answer
from attlog.core.errors import AttlogError, PluginError, UsageError, bug_sentence, shortened_message
from attlog.core.limits import MAPPED
from attlog.core.workers import Died, Worker
from attlog.words.log_text import LogText, marked
from attlog.words.text import clean

if TYPE_CHECKING:
    from mcp.server.mcpserver import MCPServer

T = TypeVar("T")
# Time of one call: a log of hours on a slow machine. Documents kept for the next part.
CALL_S, MAX_KEPT = 900.0, 16
# Time between reports of progress, and between looks whether a waiting call was given up: clients give up after 60 s.
PROGRESS_S, WAIT_S = 5.0, 0.5
MISSING = "the package mcp (2.0 or newer) of the Model Context Protocol is missing: pip install 'attlog[mcp]'"
INSTRUCTIONS = f"""\
attlog reads flight logs of ArduPilot and PX4: what happened, which sensors are off, how good the attitude is.
Begin with logs, then info or analyze; signals shows any field over time; explain says what a name means.
Quote numbers with their unit and 95 % interval (ci95). "unknown" or a missing value is no good news.
Each answer has at most {MAX_CHARACTERS} characters; left_out counts what lacks, part and start fetch it.
{UNTRUSTED}
Files are only read, and only below the folders that this server was started with."""
# A filter of attlog with preset and numbers, or parameters of a firmware's EKF; no file and no path.
SAFE_SETTING = re.compile(
    r"[A-Za-z0-9_]+(@[A-Za-z0-9_.-]+)?(:[A-Za-z0-9_]+=[^,:]+(,[A-Za-z0-9_]+=[^,:]+)*)?|[A-Z0-9_]+=[^,:]+(,[A-Z0-9_]+=[^,:]+)*"
)
SAFE_VALUE = re.compile(r"[-+0-9.eE]+(/[-+0-9.eE]+)*|[a-z_]{1,20}")

Log = Annotated[
    str, Field(description="Path of the log relative to a folder of this server, as the tool logs lists it")
]
Part = Annotated[str, Field(description="Return this list of the answer alone, such as findings, events or messages")]
Start = Annotated[int, Field(description="First item of that list, from 0")]


def server(folders: Sequence[Path]) -> MCPServer[Any]:
    """Return the server of some folders. UsageError without the SDK."""
    try:
        from anyio import get_cancelled_exc_class, to_thread
        from mcp.server.mcpserver import Context, MCPServer
        from mcp.server.mcpserver.exceptions import ToolError
        from mcp.types import CallToolResult, TextContent, ToolAnnotations
    except ImportError as error:
        raise UsageError(MISSING) from error
    # Annotations of tools are read when they are added.
    tools = Tools(Folders(folders))
    found = MCPServer("attlog", title="attlog", instructions=INSTRUCTIONS, version=__version__, log_level="ERROR")
    hints = ToolAnnotations(read_only_hint=True, destructive_hint=False, idempotent_hint=True, open_world_hint=False)

    def add(tool: Callable[..., dict[str, Any]]) -> None:
        async def call(*, context: Context[Any, Any], **arguments: Any) -> CallToolResult:
            current = Call(context.report_progress)
            CALL.set(current)
            try:
                document = await to_thread.run_sync(partial(tool, **arguments), abandon_on_cancel=True)
            except get_cancelled_exc_class():
                current.given_up.set()
                raise
            except AttlogError as error:
                message = clean(tools.folders.hidden(shortened_message(str(error))))
                raise ToolError(message[: MAX_CHARACTERS // 4]) from None
            text = json.dumps(document, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
            return CallToolResult(content=[TextContent(type="text", text=text)], structured_content=document)

        call.__name__, call.__doc__ = tool.__name__, tool.__doc__
        call.__annotations__ = {**tool.__annotations__, "context": Context, "return": CallToolResult}
        import inspect

        signature = inspect.signature(tool, eval_str=True)
        call.__signature__ = signature.replace(return_annotation=CallToolResult)  # type: ignore[attr-defined]
        found.add_tool(call, annotations=hints)

    for tool in (tools.logs, tools.info, tools.health, tools.analyze, tools.signals, tools.compare, tools.explain):
        add(tool)
    return found


class Call:
    """Call of a client: whether it gave up waiting, and how it hears of progress."""

    def __init__(self, report: Callable[[float, None, str], Coroutine[Any, Any, None]] | None = None) -> None:
        self.given_up = threading.Event()
        self._report, self._begun = report, time.monotonic()
        self._due = self._begun + PROGRESS_S

    def tick(self, message: dict[str, Any]) -> None:
        """Report progress if it is due. UsageError if the client gave up."""
        if self.given_up.is_set():
            raise UsageError("the client gave up this call")
        if self._report is not None and (now := time.monotonic()) >= self._due:
            from anyio import from_thread

            self._due = now + PROGRESS_S
            from_thread.run(self._report, round(now - self._begun, 1), None, "seconds so far")


CALL: ContextVar[Call] = ContextVar("CALL")


class Tools:
    """Tools by name; their signatures and docstrings are what a client sees."""

    def __init__(self, folders: Folders) -> None:
        self.folders = folders
        self._lock = threading.Lock()
        self._worker: Worker | None = None
        self._kept: OrderedDict[tuple[Any, ...], tuple[dict[str, Any], LogText]] = OrderedDict()

    def logs(
        self, containing: Annotated[str, Field(description="Part of the name")] = "", start: Start = 0
    ) -> dict[str, Any]:
        """List the logs that can be read, with their sizes."""
        return answer(self.folders.logs(containing), LogText(()), "logs" if start else "", start)

    def info(self, log: Log, part: Part = "", start: Start = 0) -> dict[str, Any]:
        """Say what is in a log: vehicle, sensors, messages, which questions it can answer and what would be needed."""
        return self._asked(answers.info, log, part, start)

    def health(self, log: Log, part: Part = "", start: Start = 0) -> dict[str, Any]:
        """Say whether the sensors can be trusted: checks with values, limits and evidence, and parameters to set."""
        return self._asked(answers.health, log, part, start)

    def analyze(
        self,
        log: Log,
        estimators: Annotated[
            str, Field(description="Filters of attlog, as mahony:kp=0.3,vqf; empty for the usual ones")
        ] = "",
        window: Annotated[
            str, Field(description="all, rest, airborne, hover, cruise, or T0:T1 in s; empty for those of the answers")
        ] = "",
        part: Part = "",
        start: Start = 0,
    ) -> dict[str, Any]:
        """Say what happened: headline, findings with evidence and actions, events, accuracy of attitude filters."""
        from attlog.estimators import items, select
        from attlog.segments.model import Segments

        wanted = tuple(items(estimators)) if estimators.strip() else ()
        for item in wanted:
            if item not in ("default", "all"):
                check_setting(item)
                with suppress(PluginError):  # of a package's filter: its row has the reason
                    select(item)
        try:
            Segments().spans(window or "all")
        except ValueError as error:
            raise UsageError(str(error)) from None
        return self._asked(answers.analyze, log, part, start, wanted, window)

    def signals(
        self,
        log: Log,
        names: Annotated[
            list[str] | None,
            Field(description="Fields, as ATT.Roll, BAT[0].Volt, vehicle_attitude.q[0]; none lists them"),
        ] = None,
        start_s: Annotated[float | None, Field(description="From this time, s from the first IMU sample")] = None,
        end_s: Annotated[float | None, Field(description="To this time, s")] = None,
        points: Annotated[int, Field(description="Points of all signals together, at most 200")] = 120,
        part: Part = "",
        start: Start = 0,
    ) -> dict[str, Any]:
        """Return fields of the log over time, thinned to their extremes, with units. Without names list the fields."""
        given = tuple(names or ())
        return self._asked(answers.signals, log, part, start, given, start_s, end_s, points)

    def compare(
        self,
        logs: Annotated[list[str], Field(description="Logs, as the tool logs lists them")],
        settings: Annotated[
            list[str],
            Field(description="Two or more, as mahony:kp=0.3, vqf; EKF2_GPS_DELAY=250 alone is against what flew"),
        ],
        part: Part = "",
        start: Start = 0,
    ) -> dict[str, Any]:
        """Compare settings of filters with the first one on logs: which is better, by how much, with intervals."""
        for setting in settings:
            check_setting(setting)
        if not logs:
            raise UsageError("name a log; the tool logs lists them")
        paths = [self.folders.find(log) for log in logs]
        names = tuple(self.folders.name(path) for path in paths)
        wanted = answers.compared_settings(settings, paths)
        return answer(*self._call(answers.compare, tuple(paths), names, wanted), part, max(start, 0))

    def explain(
        self,
        name: Annotated[
            str, Field(description="A metric (lag_ms), a check (compass_offset) or a parameter (EKF2_GPS_DELAY)")
        ],
        log: Annotated[str, Field(description="A log, for the verdict or value in it")] = "",
        part: Part = "",
        start: Start = 0,
    ) -> dict[str, Any]:
        """Say what a metric, a check or a firmware's parameter means, and with a log its verdict or value there."""
        path = self.folders.find(log) if log else None
        log_name = "" if path is None else self.folders.name(path)
        return answer(*self._call(answers.explain, name, path, log_name), part, max(start, 0))

    def _asked(
        self, function: Callable[..., answers.Answer], log: str, part: str, start: int, *more: Any
    ) -> dict[str, Any]:
        path = self.folders.find(log)
        return answer(*self._call(function, path, self.folders.name(path), *more), part, max(start, 0))

    def _call(self, function: Callable[..., answers.Answer], *arguments: Any) -> tuple[dict[str, Any], LogText]:
        """Return a document and the log's words, kept from the last call where no file has changed."""
        key = (function.__name__, *arguments, *_states(arguments))
        current = CALL.get(None) or Call()
        while not self._lock.acquire(timeout=WAIT_S):
            current.tick({})
        try:
            if key not in self._kept:
                self._kept[key] = self._in_process(current, function, *arguments)
            self._kept.move_to_end(key)
            while len(self._kept) > MAX_KEPT:
                self._kept.popitem(last=False)
            return self._kept[key]
        finally:
            self._lock.release()

    def _in_process(
        self, current: Call, function: Callable[..., answers.Answer], *arguments: Any
    ) -> tuple[dict[str, Any], LogText]:
        if self._worker is None or not self._worker.alive:
            self._worker = Worker.start({MAPPED: "1"})
        try:
            current.tick({})
            done = self._worker.call(watched, function, *arguments, seconds=CALL_S, on_message=current.tick)
            document, texts = done
        except AttlogError as error:  # with words of the log
            raise UsageError(f"no answer: {marked(self.folders.hidden(shortened_message(str(error))), 1000)}") from None
        except Died as died:
            raise UsageError(f"this log cannot be answered: its process {died}") from None
        except Exception as error:
            raise UsageError(marked(bug_sentence("The answer", error), 1000)) from None
        return document, LogText(texts)


def watched(function: Callable[..., T], *arguments: Any, on_message: Callable[[dict[str, Any]], None]) -> T:
    """Call a function in a process whose caller watches the time and may give up."""
    return function(*arguments)


def check_setting(text: str) -> None:
    """Raise UsageError for a setting that is no filter of attlog with numbers: a file would run code or be read."""
    from attlog.estimators.registry import BUILT_IN, FLOWN

    shape = SAFE_SETTING.fullmatch(text.strip())
    values = re.findall(r"=([^,]*)", text)
    name = text.partition(":")[0].partition("@")[0].strip()
    known = (
        name in (*BUILT_IN, *FLOWN) or (name.isupper() and "=" in text) or re.match(r"[A-Z][A-Z0-9_]+=", text.strip())
    )
    if shape is None or not known or not all(SAFE_VALUE.fullmatch(value.strip()) for value in values):
        raise UsageError(
            f"{text[:60]!r} is no filter of attlog with numbers; filters and values from files are not run here"
        )


def _states(arguments: Sequence[Any]) -> list[tuple[int, int]]:
    """Return size and time of each file among the arguments."""
    paths = [x for one in arguments for x in (one if isinstance(one, tuple) else (one,)) if isinstance(x, Path)]
    return [(path.stat().st_size, path.stat().st_mtime_ns) for path in paths]
