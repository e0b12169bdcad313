"""Files above 2 GB are indexed in 64-bit offsets; what is read does not depend on the width."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from attlog import formats
from attlog.formats.dataflash import compiled as dataflash_compiled
from attlog.formats.dataflash import index as dataflash_index
from attlog.formats.mapping import offset_type
from attlog.formats.mavlink import compiled as mavlink_compiled
from attlog.formats.mavlink import index as mavlink_index
from attlog.formats.ulog import index as ulog_index
from attlog.formats.ulog import reader as ulog_reader


@pytest.mark.parametrize("name", ["copter_steps_stabilize.bin", "copter_steps_stabilize.tlog", "px4_hover.ulg"])
def test_offsets_of_both_widths_give_the_same_log(
    name: str, samples: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    raw = bytearray((samples / name).read_bytes()[:400_000])
    raw[200_000:200_100] = bytes(100)
    path = tmp_path / name
    path.write_bytes(raw)
    narrow = formats.open(path)
    for module in (dataflash_index, dataflash_compiled, mavlink_index, mavlink_compiled, ulog_index, ulog_reader):
        monkeypatch.setattr(module, "offset_type", lambda size: np.int64)
    wide = formats.open(path)
    assert narrow.keys() == wide.keys()
    assert narrow.damage == wide.damage != []
    for key, table in narrow.items():
        assert (table.offsets.dtype, wide[key].offsets.dtype) == (np.int32, np.int64)
        assert np.array_equal(table.offsets, wide[key].offsets)
        for column in table.fields:
            assert table[column].tobytes() == wide[key][column].tobytes()


def test_offsets_hold_the_end_of_a_record_that_begins_at_the_end() -> None:
    for size in (1, 1 << 30, (1 << 31) - 70_000, 1 << 31, 5 << 30):
        assert size + 65_538 <= np.iinfo(offset_type(size)).max
