"""Functions called in another process: values come back, limits hold, a death has a reason, nothing stays behind."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from attlog.core.forks import Closed, Forks, _Server, in_processes
from attlog.core.workers import Child, Died, NonsenseError, TooLong, TooMuchMemory, Wire, parts, value
from tests.core import worker_functions

Start = Callable[[], Child]


@pytest.fixture(scope="module")
def forks() -> Iterator[Forks]:
    kept = Forks(["tests.core.worker_functions"])
    yield kept
    kept.close()


@pytest.fixture(params=["fresh", "forked"])
def start(request: pytest.FixtureRequest, forks: Forks) -> Iterator[Start]:
    started: list[Child] = []

    def begin() -> Child:
        started.append(Child.started() if request.param == "fresh" else forks.child())
        return started[-1]

    yield begin
    for child in started:
        child.end()


def gone(pid: int) -> bool:
    for _ in range(200):
        try:
            with open(f"/proc/{pid}/stat") as stat:
                if stat.read().rpartition(")")[2].split()[0] == "Z":
                    return True
        except OSError:
            return True
        time.sleep(0.02)
    return False


def test_arrays_and_errors_come_back_and_the_process_serves_again(start: Start) -> None:
    child = start()
    x = np.arange(1_000_000.0).reshape(-1, 2)
    back = child.call(worker_functions.negated, x)
    np.testing.assert_array_equal(back, -x)
    back[0] = 7.0  # a result may be written to
    with pytest.raises(ValueError, match="no good"):
        child.call(worker_functions.raising)
    with pytest.raises(Exception, match="pickle"):
        child.call(worker_functions.lambda_)
    first = child.call(worker_functions.process)
    assert child.call(worker_functions.process) == first != os.getpid()


def test_what_is_told_comes_in_order_before_the_result(start: Start) -> None:
    told: list[int] = []
    assert start().call(worker_functions.telling, 100, tell=lambda m: told.extend(m.values())) == "done"
    assert told == list(range(100))


def test_a_process_that_takes_too_long_is_ended(start: Start) -> None:
    child = start()
    pid = child.call(worker_functions.process)
    began = time.monotonic()
    with pytest.raises(TooLong, match=r"longer than 0\.4 s"):
        child.call(worker_functions.sleeping, 60.0, seconds=0.4)
    assert time.monotonic() - began < 5.0
    assert gone(pid)
    assert not child.alive


def test_a_process_that_holds_too_much_memory_is_ended(start: Start) -> None:
    with pytest.raises(TooMuchMemory, match="more than 300 MB"):
        start().call(worker_functions.filling, 400.0, memory_mb=300.0)


@pytest.mark.parametrize(
    ("function", "argument", "words"),
    [
        (worker_functions.ending, 7, r"ended without a word \(exit status 7\)"),
        (worker_functions.killing, 11, r"crashed \(SIGSEGV\)"),
        (worker_functions.killing, 9, "killed from outside"),
    ],
)
def test_a_death_is_told_with_its_reason(
    start: Start, function: Callable[[int], None], argument: int, words: str
) -> None:
    with pytest.raises(Died, match=words):
        start().call(function, argument)


def test_an_interrupt_is_left_to_the_caller(start: Start) -> None:
    assert start().call(worker_functions.interrupting) == "went on"


def test_what_a_process_has_started_ends_with_it(start: Start) -> None:
    child = start()
    pid = child.call(worker_functions.starting)
    child.end()
    assert gone(pid)


def test_processes_end_with_a_caller_that_is_killed() -> None:
    """Also one that holds the interpreter lock, where no thread of its own could end it."""
    code = (
        "import re, sys\nfrom attlog.core.forks import Forks\n"
        "from tests.core import worker_functions\nforks = Forks()\n"
        "children = [forks.child(), forks.child()]\n"
        "print(*[child.call(worker_functions.process) for child in children], flush=True)\n"
        "children[0].call(re.match, '(a+)+$', 'a' * 60 + 'b')"
    )
    caller = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert caller.stdout is not None
    pids = [int(word) for word in caller.stdout.readline().split()]
    time.sleep(0.2)
    caller.kill()
    caller.wait()
    caller.stdout.close()
    assert len(pids) == 2
    assert all(map(gone, pids))


def test_closing_forks_ends_what_they_do_and_starts_nothing_more() -> None:
    forks = Forks()
    ended: list[BaseException] = []
    child = forks.child()

    def run() -> None:
        try:
            child.call(worker_functions.sleeping, 60.0)
        except Died as died:
            ended.append(died)

    thread = threading.Thread(target=run)
    thread.start()
    time.sleep(0.2)
    forks.close()
    thread.join(10.0)
    assert len(ended) == 1
    with pytest.raises(Closed):
        forks.child()
    forks.close()


def test_what_forks_prepare_is_there_in_every_child() -> None:
    forks = Forks()
    forks.prepare(worker_functions.mark, "loaded")
    forks.prepare(worker_functions.mark, "twice")
    for _ in range(2):
        with forks.child() as child:
            assert child.call(worker_functions.marks) == ["loaded"]
    assert worker_functions.marks() == []
    forks.close()


def test_a_forking_program_that_died_is_begun_again() -> None:
    forks = Forks()
    with forks.child() as child:
        program = child.call(worker_functions.parent)
        os.kill(program, 9)
        with pytest.raises(Died, match="so is the one that started it"):
            child.call(worker_functions.sleeping, 60.0)
    with forks.child() as child:
        assert child.call(worker_functions.parent) != program
    forks.close()


def test_values_arrive_whole_however_they_are_cut_and_nonsense_is_no_value() -> None:
    near, far = socket.socketpair()
    one, other = Wire(near), Wire(far, most_bytes=1000)
    sent = {"x": np.arange(5.0), "text": "y" * 100}
    frame = parts(sent)
    pieces = b"".join([len(frame).to_bytes(4, "big"), *(len(p).to_bytes(8, "big") for p in frame), *map(bytes, frame)])
    thread = threading.Thread(target=lambda: [near.sendall(pieces[k : k + 1]) for k in range(len(pieces))])
    thread.start()
    found = value(other.receive(1.0, 5.0))
    thread.join()
    np.testing.assert_array_equal(found["x"], sent["x"])
    assert found["text"] == sent["text"]
    with pytest.raises(TimeoutError):
        other.receive(0.01)
    one.send(bytes(2000))
    with pytest.raises(NonsenseError):
        other.receive(1.0)
    one.close()
    far.close()


# The program that forks children: what comes together is carried out together.


@pytest.mark.skipif(sys.platform == "win32", reason="no fork")
def test_a_child_that_ends_as_its_caller_lets_go_of_it_ends_nothing_else() -> None:
    """Its end, the end of its life and the end of the orders are read in one batch, in this order."""
    pairs = [socket.socketpair() for _ in range(3)]
    (parent, control), (wake, waker), (held, life) = pairs
    server = _Server(control, wake, waker)
    pid = os.fork()
    if not pid:
        os._exit(0)
    os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)  # it has ended, and is still to be reaped
    server._lives[pid] = life
    server._events.register(life, 1)
    waker.send(b"x")
    held.close()
    parent.close()
    server.run()
    assert server._lives == {}
    with pytest.raises(ChildProcessError):
        os.waitpid(pid, 0)
    for end in (control, wake, waker):
        end.close()


# The same work on several things in several processes: all results, and a death costs its own thing alone.


def test_a_process_that_dies_costs_its_own_result_alone() -> None:
    found = dict(in_processes(worker_functions.square, {k: (k,) for k in range(6)}, 2))
    died = found.pop(3)
    assert isinstance(died, Died)
    assert "exit status 5" in str(died)
    assert found == {k: k * k for k in (0, 1, 2, 4, 5)}


def test_a_loop_that_is_left_ends_what_runs() -> None:
    began = time.monotonic()
    for _, result in in_processes(worker_functions.sleeping, {0: (0.0,), 1: (60.0,)}, 2):
        assert result is None
        break
    assert time.monotonic() - began < 20.0
