"""What is written as telemetry log comes back, from our reader and from pymavlink."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from attlog import formats
from attlog.base.errors import UsageError
from attlog.formats import Recording
from attlog.formats.mavlink import reader
from attlog.formats.mavlink.crc import crc_of_rows
from attlog.formats.mavlink.dialect import dialect, layout
from tests.formats.mavlink.test_tlog import read_with_pymavlink

Log = dict[tuple[str, int], dict[str, np.ndarray]]
START = 1_700_000_000_000_000


@st.composite
def logs(draw: st.DrawFn) -> Log:
    """Random messages of the dialect from random senders, with random values and many trailing zeros."""
    messages: Log = {}
    for number in draw(st.lists(st.sampled_from(sorted(dialect())), min_size=1, max_size=5, unique=True)):
        name, fields, _ = layout(number)
        n = draw(st.integers(1, 5))
        columns = {reader.STAMP: START + np.cumsum(draw(hnp.arrays(np.uint32, n)), dtype=np.int64)}
        for field in draw(st.lists(st.sampled_from(list(fields)), max_size=6, unique=True)):
            kind = fields[field].dtype
            columns[field] = (
                np.array(draw(st.lists(st.text("aB9 ", max_size=kind.itemsize), min_size=n, max_size=n)), kind)
                if kind.kind == "S"
                else draw(hnp.arrays(kind.base, (n, *kind.shape)))
            )
        messages[name, draw(st.integers(0, 65535))] = columns
    return messages


@pytest.mark.slow
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(messages=logs())
def test_random_logs_come_back_and_pymavlink_reads_the_same(messages: Log, tmp_path: Path) -> None:
    path = tmp_path / "random.tlog"
    formats.write(path, Recording(messages))
    log = reader.read(path)
    theirs, refused = read_with_pymavlink(path, stamped=True)
    assert (log.damage, log.damage_bytes, refused) == ([], 0, 0)
    assert set(log) == set(messages) == set(theirs)
    for key, expected in messages.items():
        for column, values in expected.items():
            assert log[key][column].tobytes() == values.tobytes(), (key, column)
        for column in log[key].fields:
            assert len(theirs[key][column]) == len(log[key])


@given(st.binary(min_size=2, max_size=300))
def test_the_checksum_is_that_of_pymavlink(raw: bytes) -> None:
    from pymavlink.generator.mavcrc import x25crc

    assert crc_of_rows(np.frombuffer(raw, np.uint8)[np.newaxis])[0] == x25crc(raw).crc


@pytest.mark.parametrize(
    ("messages", "reason"),
    [
        ({("NOT_A_MESSAGE", 257): {reader.STAMP: np.zeros(1, np.int64)}}, "not a message"),
        ({("ATTITUDE", 257): {"roll": np.zeros(1)}}, "needs a column _t_us"),
        ({("ATTITUDE", 257): {reader.STAMP: np.zeros(1, np.int64), "rol": np.zeros(1)}}, "has no field rol"),
    ],
)
def test_what_mavlink_does_not_know_is_refused(tmp_path: Path, messages: Log, reason: str) -> None:
    with pytest.raises(UsageError, match=reason):
        formats.write(tmp_path / "x.tlog", Recording(messages))
