"""The last barrier: what fails unexpectedly while one part is made costs that part and not the whole log.

Readers and checks refuse what is wrong where it enters. A log that is hostile in a way
nobody thought of still meets a line that did not expect it: then one sensor, one check or
one metric is missing, a problem says so and asks for a report, and the rest goes on. Tests
set ``ATTLOG_RAISE``, so that the barrier hides nothing from them.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TypeVar

from attlog.base.errors import AttlogError

T = TypeVar("T")
U = TypeVar("U")
RAISE = "ATTLOG_RAISE"
"""The environment variable with which failures go through the barrier."""


def guarded(what: str, make: Callable[[], T], otherwise: Callable[[str], U]) -> T | U:
    """What ``make`` returns; where it fails in a way that nobody expected, what ``otherwise`` returns for the sentence.

    ``what`` begins the sentence ("The barometer"). Errors that attlog raises on purpose, too little
    memory and an interrupt pass.
    """
    try:
        return make()
    except (AttlogError, MemoryError):
        raise
    except Exception as error:
        if os.environ.get(RAISE):
            raise
        return otherwise(sentence(what, error))


def sentence(what: str, error: Exception) -> str:
    """What is missing, and where attlog failed, so that it can be reported and found."""
    place, trace = "", error.__traceback__
    while trace is not None:
        name = trace.tb_frame.f_globals.get("__name__", "")
        if name.partition(".")[0] == "attlog":
            place = f" in {name}, line {trace.tb_lineno}"
        trace = trace.tb_next
    reason = " ".join(str(error).split())[:200]
    return f"{what} is left out because of a bug in attlog ({type(error).__name__}{place}: {reason}); please report it."
