"""The same work on several things in several processes: all results, and a death costs its own thing alone."""

from __future__ import annotations

import time

from attlog.base.processes.child import Died
from attlog.base.processes.pool import in_processes
from tests.base.processes import work


def test_a_process_that_dies_costs_its_own_result_alone() -> None:
    found = dict(in_processes(work.square, {k: (k,) for k in range(6)}, 2))
    died = found.pop(3)
    assert isinstance(died, Died)
    assert "exit status 5" in str(died)
    assert found == {k: k * k for k in (0, 1, 2, 4, 5)}


def test_a_loop_that_is_left_ends_what_runs() -> None:
    began = time.monotonic()
    for _, result in in_processes(work.sleeping, {0: (0.0,), 1: (60.0,)}, 2):
        assert result is None
        break
    assert time.monotonic() - began < 20.0
