"""Functions called in another process: values come back, limits hold, a death has a reason, nothing stays behind."""

from __future__ import annotations

import os
import pickle
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from attlog.core.workers import Channel, Closed, Died, ForkServer, TooLong, TooMuchMemory, Worker
from tests.core import worker_functions

Start = Callable[[], Worker]


@pytest.fixture(scope="module")
def forks() -> Iterator[ForkServer]:
    kept = ForkServer(["tests.core.worker_functions"])
    yield kept
    kept.close()


@pytest.fixture(params=["fresh", "forked"])
def start(request: pytest.FixtureRequest, forks: ForkServer) -> Iterator[Start]:
    started: list[Worker] = []

    def begin() -> Worker:
        started.append(Worker.start() if request.param == "fresh" else forks.worker())
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


def test_a_server_that_nobody_closes_ends_without_noise() -> None:
    code = (
        "import os\nfrom attlog.core.workers import ForkServer\n"
        "kept = ForkServer(['json'])\nprint(kept.worker().call(os.getpid))\n"
        "def lost():\n    forks = ForkServer(['json'])\n    print(forks.worker().call(os.getpid))\nlost()\n"
    )
    done = subprocess.run([sys.executable, "-W", "always::ResourceWarning", "-c", code], capture_output=True, text=True)
    assert "still running" not in done.stderr
    assert done.returncode == 0
    assert all(gone(int(pid)) for pid in done.stdout.split())


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


def test_messages_come_in_order_before_the_result(start: Start) -> None:
    received: list[int] = []
    assert start().call(worker_functions.counting, 100, on_message=lambda m: received.extend(m.values())) == "done"
    assert received == list(range(100))


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
        (worker_functions.ending, 7, r"ended without an answer \(exit status 7\)"),
        (worker_functions.killing, 11, r"crashed \(SIGSEGV\)"),
        (worker_functions.killing, 9, "killed from outside"),
    ],
)
def test_a_death_is_told_with_its_reason(
    start: Start, function: Callable[[int], None], argument: int, words: str
) -> None:
    with pytest.raises(Died, match=words):
        start().call(function, argument)


def test_what_a_process_has_started_ends_with_it(start: Start) -> None:
    child = start()
    pid = child.call(worker_functions.starting)
    child.end()
    assert gone(pid)


def test_processes_end_with_a_caller_that_is_killed() -> None:
    """Also one that holds the interpreter lock, where no thread of its own could end it."""
    code = (
        "import re, sys\nfrom attlog.core.workers import ForkServer\n"
        "from tests.core import worker_functions\nforks = ForkServer()\n"
        "children = [forks.worker(), forks.worker()]\n"
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
    forks = ForkServer()
    ended: list[BaseException] = []
    child = forks.worker()

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
        forks.worker()
    forks.close()


def test_a_forking_program_that_died_is_begun_again() -> None:
    forks = ForkServer()
    with forks.worker() as child:
        program = child.call(worker_functions.parent)
        os.kill(program, 9)
        with pytest.raises(Died, match="so is the process that started it"):
            child.call(worker_functions.sleeping, 60.0)
    with forks.worker() as child:
        assert child.call(worker_functions.parent) != program
    forks.close()


def test_a_program_that_dies_while_it_prepares_is_replaced_at_once() -> None:
    """A dying process still counts as alive for a moment: ten tries meet it in some."""
    for _ in range(10):
        forks = ForkServer()
        with pytest.raises(Died):
            forks.prepare(worker_functions.killing, 9)
        with forks.worker() as child:
            assert child.call(worker_functions.parent) > 0
        forks.close()


def test_values_arrive_whole_however_they_are_cut_and_too_long_ones_not_at_all() -> None:
    near, far = socket.socketpair()
    receiver = Channel(far, max_bytes=1000)
    sent = {"x": np.arange(5.0), "text": "y" * 100}
    frame = pickle.dumps(sent)
    wire = len(frame).to_bytes(8, "big") + frame
    thread = threading.Thread(target=lambda: [near.sendall(wire[k : k + 1]) for k in range(len(wire))])
    thread.start()
    found = pickle.loads(receiver.receive(1.0, time.monotonic() + 5.0))
    thread.join()
    np.testing.assert_array_equal(found["x"], sent["x"])
    assert found["text"] == sent["text"]
    with pytest.raises(TimeoutError):
        receiver.receive(0.01)
    Channel(near).send(bytes(2000))
    with pytest.raises(ValueError, match="bytes"):
        receiver.receive(1.0)
    near.close()
    far.close()


# The same work on several things in several processes: all results, and a death costs its own thing alone.
