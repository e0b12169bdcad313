"""The ULog reader tells what pyulog tells, on every undamaged log in hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pyulog import ULog

from attlog.base.errors import LogUnusable, NotALog
from attlog.formats import Messages
from attlog.formats.ulog import reader
from attlog.formats.ulog.index import NumbaChain, NumpyChain
from tests.conftest import SAMPLES, corpus_logs

CLEAN = [p for p in corpus_logs(".ulg") if not p.name.startswith("made_")]


@pytest.fixture(params=CLEAN, ids=lambda p: p.name, scope="module")
def both(request: pytest.FixtureRequest) -> tuple[Messages, ULog]:
    return reader.read(request.param), ULog(str(request.param))


def columns_of(data: ULog.Data) -> dict[str, np.ndarray]:
    """What the official library shows, without padding."""
    return {n: v for n, v in data.data.items() if not n.rpartition(".")[2].startswith("_padding")}


def flat(log: Messages, key: tuple[str, int]) -> dict[str, np.ndarray]:
    """Our columns named and typed as the official library does: one per array element, text as small integers."""
    found = {}
    for name, field in log[key].fields.items():
        column = log[key][name]
        if field.dtype.kind == "S":
            width = field.dtype.itemsize
            raw = np.frombuffer(column.tobytes(), np.int8).reshape(len(column), width)
            found |= {f"{name}[{i}]": raw[:, i] for i in range(width)} if width > 1 else {name: raw[:, 0]}
        elif column.ndim == 2:
            found |= {f"{name}[{i}]": column[:, i] for i in range(column.shape[1])}
        else:
            found[name] = column
    return found


def test_every_topic_field_and_row_is_equal(both: tuple[Messages, ULog]) -> None:
    ours, theirs = both
    assert set(ours) == {(d.name, d.multi_id) for d in theirs.data_list}
    for data in theirs.data_list:
        mine, reference = flat(ours, (data.name, data.multi_id)), columns_of(data)
        assert list(mine) == list(reference)
        for name, column in reference.items():
            assert mine[name].dtype == column.dtype, (data.name, name)
            assert mine[name].tobytes() == column.tobytes(), (data.name, name)


def test_parameters_are_equal(both: tuple[Messages, ULog]) -> None:
    ours, theirs = both
    initial = {p.name: p.value for p in ours.params if p.t_us is None and not p.is_default}
    assert initial == theirs.initial_parameters
    changed = [(p.name, p.value) for p in ours.params if p.t_us is not None]
    assert changed == [(name, value) for _, name, value in theirs.changed_parameters]
    for mine, (their_time, _, _) in zip(
        [p for p in ours.params if p.t_us is not None], theirs.changed_parameters, strict=True
    ):
        assert mine.t_us <= their_time, "the record before, not the largest stamp so far"
    defaults = {p.name for p in ours.params if p.is_default}
    assert defaults == set(theirs.get_default_parameters(0)) | set(theirs.get_default_parameters(1))


def test_texts_and_dropouts_are_equal(both: tuple[Messages, ULog]) -> None:
    ours, theirs = both
    tagged = [m for messages in theirs.logged_messages_tagged.values() for m in messages]
    expected = sorted((m.timestamp, m.log_level - ord("0"), m.message) for m in [*theirs.logged_messages, *tagged])
    assert sorted((t.t_us, t.level, t.text) for t in ours.texts) == expected
    assert ours.dropouts_ms == [d.duration for d in theirs.dropouts]


def test_info_is_equal(both: tuple[Messages, ULog]) -> None:
    ours, theirs = both
    for name, value in theirs.msg_info_dict.items():
        assert ours.info[name] == (value.rstrip("\0") if isinstance(value, str) else value), name
    for name, groups in theirs.msg_info_multiple_dict.items():
        joined = ["".join(p.split("\0")[0] for p in g) if isinstance(g[0], str) else b"".join(g) for g in groups]
        assert ours.info[name] == joined, name


def test_undamaged_logs_have_no_damage(both: tuple[Messages, ULog]) -> None:
    ours, _ = both
    assert (ours.damage_bytes, ours.damage) == (0, [])


@pytest.mark.parametrize("path", CLEAN[:6], ids=lambda p: p.name)
def test_compiled_and_numpy_index_find_the_same_records(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reader, "chain", NumpyChain)
    by_numpy = reader.read(path)
    monkeypatch.setattr(reader, "chain", NumbaChain)
    compiled = reader.read(path)
    assert list(by_numpy) == list(compiled)
    assert all(np.array_equal(by_numpy[k].offsets, compiled[k].offsets) for k in by_numpy)


def test_columns_of_selected_rows_are_those_rows() -> None:
    table = reader.read(SAMPLES / "px4_steps.ulg").first("sensor_combined")
    assert table is not None
    part = table.rows(slice(100, 200))
    assert np.array_equal(part["gyro_rad"], table["gyro_rad"][100:200])
    assert np.array_equal(part["gyro_rad[2]"], table["gyro_rad"][100:200, 2])
    assert "gyro_rad[3]" not in table
    with pytest.raises(KeyError, match="sensor_combined has no field"):
        table["gyro_rad[3]"]


def test_unknown_incompatible_flag_stops_with_a_reason(tmp_path: Path) -> None:
    raw = bytearray((SAMPLES / "px4_hover.ulg").read_bytes()[:5000])
    assert raw[18] == ord("B")
    raw[19 + 8] = 0b10
    (tmp_path / "future.ulg").write_bytes(raw)
    with pytest.raises(LogUnusable, match="newer reader"):
        reader.read(tmp_path / "future.ulg")


def test_appended_data_is_read_and_the_cut_record_before_it_is_counted(tmp_path: Path) -> None:
    """A crash dump is appended behind a data section that ends in half a record."""
    raw = bytearray((SAMPLES / "px4_hover.ulg").read_bytes())
    whole = reader.read(SAMPLES / "px4_hover.ulg")
    last = max(int(t.offsets[-1]) for t in whole.values())
    offset = last + 9
    dump = b"char[4] dump"
    appended = b"\0" + bytes([len(dump)]) + dump + b"oops"
    raw[19 + 8] |= 1
    raw[19 + 16 : 19 + 24] = offset.to_bytes(8, "little")
    (tmp_path / "crash.ulg").write_bytes(raw[:offset] + len(appended).to_bytes(2, "little") + b"M" + appended)
    log = reader.read(tmp_path / "crash.ulg")
    assert log.info["dump"] == ["oops"]
    assert log.damage_bytes == 9
    assert sum(map(len, log.values())) == sum(map(len, whole.values())) - 1


def test_what_is_no_ulog_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty.ulg").write_bytes(b"")
    (tmp_path / "other.ulg").write_bytes(b"\xa3\x95" * 100)
    (tmp_path / "locked.ulg").write_bytes(b"ULogEnc" + bytes(100))
    for name, error in [("empty.ulg", LogUnusable), ("other.ulg", NotALog), ("locked.ulg", LogUnusable)]:
        with pytest.raises(error):
            reader.read(tmp_path / name)
