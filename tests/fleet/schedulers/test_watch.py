"""A watched folder: what arrives is analysed once, the index tells of it, a restart repeats nothing."""

from __future__ import annotations

import json
import shutil
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from attlog import Config
from attlog.base.errors import INTERRUPTED, OutputError
from attlog.fleet.processes.run import run_one
from attlog.fleet.records.entry import Entry
from attlog.fleet.records.lock import locked
from attlog.fleet.records.plan import Job
from attlog.fleet.records.record import MEASURED, Record, read_record
from attlog.fleet.records.work import Work
from attlog.fleet.schedulers.arrivals import Arrivals
from attlog.fleet.schedulers.batch import Outcome
from attlog.fleet.schedulers.local import Records
from attlog.fleet.schedulers.watch import watch
from attlog.fleet.sources.source import Source
from tests.conftest import SAMPLES
from tests.fleet.pages.test_index_page import inside

ONE, TWO = SAMPLES / "copter_yaw_turns.bin", SAMPLES / "px4_hover.ulg"


class Share:
    """A folder that people put logs into, and a service that watches it: each step is what happens between looks."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.out = folder / "in", folder / "out"
        self.folder.mkdir()
        self.analysed: list[str] = []
        self.finished_: list[str] = []
        self.same_: list[tuple[str, str]] = []
        self.before: Callable[[Sequence[Work]], object] = lambda _: None

    def put(self, log: Path, name: str) -> Path:
        place = self.folder / name
        place.parent.mkdir(exist_ok=True)
        shutil.copy(log, place)
        return place

    def watch(self, *steps: Callable[[], object], **job: object) -> Outcome:
        """Watch until all steps are done."""
        todo = list(steps)

        def pause(_: float) -> None:
            if not todo:
                raise KeyboardInterrupt
            todo.pop(0)()

        config = Config(estimators=["gyro"])
        made = replace(Job([], self.out, config, deterministic=True), **job)
        return watch(made, Arrivals([str(self.folder)], 0.0, self.out), self.run, self, 2, pause=pause)

    def run(self, works: Sequence[Work]) -> Records:
        self.before(works)
        self.analysed += [work.name for work in works]
        yield from (run_one(work) for work in works)

    def planned(self, works: Sequence[Work]) -> None:
        assert works, "nothing arrived"

    def finished(self, record: Record, entry: Entry) -> None:
        self.finished_.append(f"{record.name}{' again' if record.again else ''}")

    def same(self, source: Source, as_log: str) -> None:
        self.same_.append((Path(source.name).name, Path(as_log).name))

    def shown(self) -> set[str]:
        """The logs of which the index tells."""
        data, _ = inside((self.out / "index.html").read_text())
        return set(data["name"])


@pytest.fixture
def share(tmp_path: Path) -> Share:
    return Share(tmp_path)


def test_logs_are_analysed_as_they_arrive_and_the_index_tells_of_all(share: Share) -> None:
    share.put(ONE, "a.bin")
    seen: list[set[str]] = []
    outcome = share.watch(
        lambda: seen.append(share.shown()), lambda: share.put(TWO, "day/b.ulg"), lambda: seen.append(share.shown())
    )
    assert share.analysed == ["a.bin", "b.ulg"]
    assert seen == [{"a.bin"}, {"a.bin", "b.ulg"}]
    assert (outcome.total, outcome.interrupted, outcome.codes) == (2, True, {INTERRUPTED})
    assert all((share.out / f"{name}.html").is_file() for name in share.analysed)
    assert list(share.out.glob("results.*"))


def test_many_that_come_at_once_do_not_hide_the_next(share: Share) -> None:
    for k in range(5):
        (share.folder / f"{k}.ulg").write_bytes(b"no log %d" % k)
    share.before = lambda works: share.put(ONE, "0.bin") if works[0].name == "0.ulg" else None
    share.watch()
    assert sorted(share.analysed) == ["0.bin", *(f"{k}.ulg" for k in range(5))]
    assert share.analysed.index("0.ulg") < share.analysed.index("0.bin")
    assert len(share.analysed) == 6


def test_a_restart_repeats_nothing_and_reads_no_known_file(share: Share, monkeypatch: pytest.MonkeyPatch) -> None:
    share.put(ONE, "a.bin")
    (share.folder / "notes.txt").write_text("windy")
    share.watch()
    records = {name: read_record(share.out, name) for name in share.analysed}
    monkeypatch.setattr("attlog.fleet.schedulers.watch.logs_of", lambda _: pytest.fail("a known file was opened"))
    assert share.watch(lambda: None).total == 1
    assert share.analysed == ["a.bin"]
    assert {name: read_record(share.out, name) for name in share.analysed} == records


def test_a_lost_memory_costs_reading_and_no_analysis(share: Share) -> None:
    share.put(ONE, "a.bin")
    share.watch()
    (share.out / ".attlog" / "watch.json").write_text("{")
    share.watch()
    assert share.finished_ == ["a.bin", "a.bin again"]


def test_the_same_content_under_another_name_is_not_analysed_again(share: Share) -> None:
    a = share.put(ONE, "a.bin")
    share.watch(lambda: a.rename(share.folder / "c.bin"), lambda: share.put(ONE, "copy.bin"))
    assert share.analysed == ["a.bin"]
    assert share.same_ == [("c.bin", "a.bin"), ("copy.bin", "a.bin")]
    assert share.watch().total == 1
    assert len(share.same_) == 2


def test_a_changed_log_is_analysed_anew_in_its_place(share: Share) -> None:
    a = share.put(ONE, "a.bin")
    # what a.bin was before is nobody's content by the time c.bin comes
    share.watch(lambda: a.write_bytes(ONE.read_bytes()[:400_000]), lambda: share.put(ONE, "c.bin"))
    assert share.analysed == ["a.bin", "a.bin", "c.bin"]
    record = read_record(share.out, "a.bin")
    assert record is not None
    flight = json.loads((share.out / "a.bin.json").read_text())
    assert flight["log"]["size"] == 400_000


def test_a_log_that_vanishes_before_it_is_read_leaves_no_row_and_comes_back(share: Share) -> None:
    a = share.put(ONE, "a.bin")
    away = share.folder.parent / "away"
    share.before = lambda _: a.rename(away) if a.exists() and not share.finished_ and not away.exists() else None
    outcome = share.watch(lambda: None, lambda: away.rename(share.folder / "b.bin"))
    assert share.analysed == ["a.bin", "b.bin"]
    assert [entry.name for entry in outcome.entries] == ["b.bin"]
    assert read_record(share.out, "a.bin") is None


def test_a_log_that_is_gone_keeps_its_row(share: Share) -> None:
    a = share.put(ONE, "a.bin")
    share.watch(a.unlink, lambda: share.put(TWO, "b.ulg"))
    assert share.shown() == {"a.bin", "b.ulg"}
    assert share.watch().total == 2


def test_members_of_an_archive_that_arrives_are_analysed(share: Share) -> None:
    with zipfile.ZipFile(share.folder / "day.zip", "w") as file:
        file.write(ONE, "x/a.bin")
        file.write(TWO, "b.ulg")
    share.watch(lambda: share.put(ONE, "c.bin"))
    assert sorted(share.analysed) == ["a.bin", "b.ulg"]
    assert share.same_ == [("c.bin", "a.bin")]


def test_a_log_that_fails_is_a_row_and_is_not_tried_again(share: Share) -> None:
    (share.folder / "broken.ulg").write_bytes(b"no log")
    outcome = share.watch(lambda: None)
    assert [(entry.name, entry.code) for entry in outcome.entries] == [("broken.ulg", 65)]
    share.watch(lambda: None)
    assert share.analysed == ["broken.ulg"]


def test_other_settings_mean_another_analysis(share: Share) -> None:
    share.put(ONE, "a.bin")
    share.watch()
    share.watch(config=Config(estimators=["gyro", "mahony"]))
    assert share.finished_ == ["a.bin", "a.bin"]


def test_two_do_not_write_to_one_folder(share: Share) -> None:
    share.put(ONE, "a.bin")
    with locked(share.out), pytest.raises(OutputError, match="another batch"):
        share.watch()


def test_an_interrupt_in_the_middle_loses_nothing_and_repeats_nothing(share: Share) -> None:
    share.put(ONE, "a.bin")
    share.put(TWO, "b.ulg")
    told = share.finished

    def stop(record: Record, entry: Entry) -> None:
        told(record, entry)
        raise KeyboardInterrupt

    share.finished = stop  # type: ignore[method-assign]
    assert share.watch().total == 1
    share.finished = told  # type: ignore[method-assign]
    assert share.watch().total == 2
    assert sorted(share.finished_) == ["a.bin", "b.ulg"]
    assert [getattr(read_record(share.out, "a.bin"), name) > 0 for name in MEASURED] == [True] * 3
