"""What a log defines costs what its bytes cost: time and memory grow with the size, whatever is in it."""

from __future__ import annotations

import struct
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from attlog import formats
from attlog.core.limits import MAX_BOOTS, MAX_COLUMNS, MAX_FORMATS, MAX_INFO, MAX_LAYOUTS, MAX_RESUBSCRIBED
from attlog.formats import Messages
from attlog.formats.ulog import reader
from tests.conftest import few
from tests.formats.ulog import crafted
from tests.formats.ulog.crafted import BUILDERS, PLAIN, STAMP, data, form, log, one, record, subscribe

Build = Callable[[int], bytes]
SMALL, FACTOR = 800, 4


def read(raw: bytes, path: Path, columns: int = 100) -> Messages:
    """The log with so many columns of each table decoded."""
    path.write_bytes(raw)
    found = formats.open(path)
    for table in found.values():
        for column in list(table.fields)[:columns]:
            assert len(table[column]) == len(table)
    return found


def cost(raw: bytes, path: Path) -> float:
    begin = time.process_time()
    read(raw, path)
    return time.process_time() - begin


@pytest.mark.parametrize("build", few(BUILDERS, 8), ids=lambda b: b.__name__)
def test_four_times_the_bytes_cost_about_four_times_the_time(build: Build, tmp_path: Path) -> None:
    path = tmp_path / "crafted.ulg"
    small, large = build(SMALL), build(FACTOR * SMALL)
    for _ in range(3):  # another process may have taken the cache
        if cost(large, path) < 2 * FACTOR * cost(small, path) + 0.05:
            return
    pytest.fail("time grows faster than the file")


@pytest.mark.slow
@pytest.mark.parametrize("build", few(BUILDERS, 8), ids=lambda b: b.__name__)
def test_memory_stays_below_ten_megabytes_and_fifty_times_the_file(build: Build, tmp_path: Path) -> None:
    raw = build(SMALL // 4)
    tracemalloc.start()
    try:
        read(raw, tmp_path / "crafted.ulg")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 10e6 + 50 * len(raw)


@pytest.mark.parametrize(
    ("build", "most", "said"),
    [
        (crafted.formats, MAX_FORMATS, "formats; the first 4096 count"),
        (crafted.statements, MAX_INFO, "statements; the first 10000 are kept"),
        (crafted.resubscriptions, MAX_RESUBSCRIBED, "ids that change their topic"),
        (crafted.bare_headers, MAX_BOOTS, "headers; from the 100th on"),
        (crafted.layouts, MAX_LAYOUTS, "a has more than 64 layouts"),
        (crafted.wide_topics, MAX_COLUMNS // 4000, "it and what follows it is left out"),
    ],
    ids=lambda x: getattr(x, "__name__", None),
)
def test_what_goes_beyond_a_limit_is_said_once_and_the_rest_is_read(
    build: Build, most: int, said: str, tmp_path: Path
) -> None:
    within, beyond = read(build(most - 10), tmp_path / "in.ulg"), read(build(most + 20), tmp_path / "out.ulg")
    assert within.remarks == []
    [problem] = beyond.remarks
    assert problem.code == "log_limit"
    assert said in problem.text
    assert len(beyond) >= len(within)


def test_a_topic_whose_definition_asks_for_too_much_costs_only_itself(tmp_path: Path) -> None:
    for members, why in [
        (f"{STAMP}float[4000000000] x;", "big asks for 16000000008 bytes, a record holds 65533"),
        (f"{STAMP}float[99999999999999999999] x;", "bytes, a record holds 65533"),
        (f"{STAMP}little[200][1] x;", "the definition of big cannot be read"),
        (f"{STAMP}nowhere x;", "the definition of nowhere is missing"),
        (f"{STAMP}big x;", "big contains itself"),
        (f"{STAMP}little[5000] x;", "big asks for 5001 fields, more than the 4096"),
        ("uint8_t[3] _padding0;", "it holds nothing"),
        ("uint8_t[0] x;", "it holds nothing"),
    ]:
        raw = log(
            PLAIN,
            form("little:uint8_t y;"),
            form(f"big:{members}"),
            subscribe("big", 2),
            *(one(k) + data(2, 10_000 + k, bytes(20)) for k in range(20)),
        )
        found = read(raw, tmp_path / "big.ulg")
        assert list(found) == [("a", 0)], members
        assert found["a", 0]["x"].tolist() == [1.0] * 20
        [lost] = [d.lost for d in found.damage]
        assert lost.startswith("20 records (660 bytes) of big, which cannot be used")
        assert why in lost
        [problem] = found.remarks
        assert (problem.code, problem.count) == ("unreadable_message", 1)
        assert problem.text.startswith("big cannot be used: ")
        assert why in problem.text


def test_a_topic_of_the_largest_size_is_read(tmp_path: Path) -> None:
    for floats, readable in [(16381, True), (16382, False)]:
        raw = log(
            form(f"a:{STAMP}float[{floats}] x;"),
            subscribe("a", 7),
            *(data(7, k, bytes(range(1, 5)) * floats) for k in range(1, 4) if readable),
        )
        found = read(raw, tmp_path / "large.ulg")
        assert len(found) == readable
        if readable:
            assert found["a", 0]["x"].shape == (3, floats)
            assert (found["a", 0]["x"] == np.frombuffer(bytes(range(1, 5)), "<f4")[0]).all()


def test_of_fields_with_one_name_the_first_is_read(tmp_path: Path) -> None:
    path = tmp_path / "twice.ulg"
    rest = struct.pack("<fQf", 1.0, 77, 2.0)
    path.write_bytes(
        log(
            form(f"a:{STAMP}float x;uint64_t timestamp;float x;"),
            subscribe("a", 1),
            *(data(1, 5000 + k, rest) for k in range(5)),
        )
    )
    table = formats.open(path)["a", 0]
    np.testing.assert_array_equal(table["x"], 1.0)
    np.testing.assert_array_equal(table["timestamp"], 5000 + np.arange(5))


def test_records_of_a_topic_that_changes_its_layout_are_read_by_their_own(tmp_path: Path) -> None:
    """Two ids stand for one topic, before and after its format was declared anew; their records alternate."""
    raw = log(
        PLAIN,
        form(f"a:{STAMP}uint32_t y;float x;"),
        subscribe("a", 2),
        *(one(2 * k) + data(2, 10_001 + 2 * k, b"\7\0\0\0\0\0\0\x40") for k in range(30)),
    )
    table = read(raw, tmp_path / "two.ulg")["a", 0]
    assert list(table.fields) == ["timestamp", "x"]
    assert table["timestamp"].tolist() == list(range(10_000, 10_060))
    assert table["x"].tolist() == [1.0, 2.0] * 30
    assert table.rows(slice(3, 7))["x"].tolist() == [2.0, 1.0, 2.0, 1.0]


@pytest.mark.parametrize(
    "offsets", [(0, 0, 0), (1, 2, 3), (2**64 - 1,) * 3, (2**63, 400, 2**32), (200, 199, 198), (200, 200, 200)]
)
def test_appended_data_may_be_said_to_stand_anywhere(offsets: tuple[int, int, int], tmp_path: Path) -> None:
    flags = bytes(8) + b"\1" + bytes(7) + b"".join(x.to_bytes(8, "little") for x in offsets)
    raw = log(record("B", flags), PLAIN, *(one(k) for k in range(100)))
    found = read(raw, tmp_path / "appended.ulg")
    assert len(found["a", 0]) >= 97


def test_the_time_of_a_parameter_and_of_a_text_may_be_any_number(tmp_path: Path) -> None:
    late = 2**64 - 1
    raw = log(
        PLAIN,
        one(1),
        data(1, late, bytes(4)),
        record("P", crafted.keyed("float P", b"\0\0\xc0\x7f")),
        record("L", b"6" + late.to_bytes(8, "little") + b"late"),
        one(2),
        one(3),
    )
    found = read(raw, tmp_path / "late.ulg")
    [change] = found.params
    assert change.t_us is None or 0 <= change.t_us < 2**63
    assert found["a", 0]["timestamp"][1] == late, "an undamaged log reads as it stands"
    assert [t.text for t in found.texts] == ["late"]


@pytest.mark.parametrize("odd", ["bad name", "../x", "a.b", "t\u00fcr"])
def test_a_refused_name_costs_no_neighbouring_definition(odd: str, tmp_path: Path) -> None:
    """As pyulog reads the other topic, in a log too short for three good records between the bad ones."""
    from pyulog import ULog

    path = tmp_path / "tiny.ulg"
    path.write_bytes(
        crafted.log(
            crafted.form(f"{odd}:{crafted.STAMP}float x;"),
            crafted.form(f"a:{crafted.STAMP}float x;"),
            crafted.subscribe(odd, 2),
            crafted.subscribe("a", 1),
            crafted.one(0),
            crafted.data(2, 10_001, b"\0" * 4),
            crafted.one(2),
            crafted.one(3),
        )
    )
    log = formats.open(path)
    official = next(data for data in ULog(str(path)).data_list if data.name == "a")
    np.testing.assert_array_equal(log["a", 0]["timestamp"], official.data["timestamp"])
    assert len(log["a", 0]) == 3
    assert [place.lost for place in log.damage if "no records" in place.lost] == []


def test_records_before_an_id_changes_its_topic_keep_the_topic_they_had(tmp_path: Path) -> None:
    raw = log(
        PLAIN,
        form(f"b:{STAMP}float y;"),
        *(one(k) for k in range(20)),
        subscribe("b", 1),
        *(one(k) for k in range(20, 50)),
    )
    found = read(raw, tmp_path / "changes.ulg")
    assert {key: table["timestamp"].tolist() for key, table in found.items()} == {
        ("a", 0): [10_000 + k for k in range(20)],
        ("b", 0): [10_000 + k for k in range(20, 50)],
    }


def test_records_without_subscription_are_followed_not_asked_one_by_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Four topics whose records alternate; two of them have lost their subscription, one is subscribed late."""
    names = {3: "b", 4: "c", 5: "d"}
    forms = [form(f"{name}:{STAMP}uint8_t[{i}] x;") for i, name in names.items()]
    body = [b"".join([one(k), *(data(i, 10_000 + k, bytes(i)) for i in names)]) for k in range(4000)]
    raw = log(PLAIN, *forms, *body[:2000], subscribe("d", 5), *body[2000:])
    asked = []
    loose = reader._Reader._uncertain_record
    monkeypatch.setattr(reader._Reader, "_uncertain_record", lambda *given: asked.append(given) or loose(*given))
    found = read(raw, tmp_path / "lost.ulg")
    assert {name: len(table) for (name, _), table in found.items()} == {"a": 4000, "b": 4000, "c": 4000, "d": 2000}
    assert found["c", 0]["timestamp"].tolist() == [10_000 + k for k in range(4000)]
    assert sorted(d.lost.partition(" (")[0] for d in found.damage) == [
        "2,000 records",
        "the subscription of id 3; its 4,000 records can only be b",
        "the subscription of id 4; its 4,000 records can only be c",
    ]
    assert len(asked) < 100
