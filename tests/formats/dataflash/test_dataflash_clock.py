"""Which column of a record is the boot clock, in the formats that ArduPilot's versions wrote."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from attlog.formats.dataflash.clock import time_column


@pytest.mark.parametrize(
    ("columns", "letters", "clock"),
    [
        ("TimeUS,Status,GMS,GWk,NSats", "QBIHB", ("TimeUS", 1)),  # 3.3 and later
        ("Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs,VZ,T", "BIHBcLLeeEefI", ("T", 1000)),  # 3.1, 3.2
        ("Status,GMS,GWk,NSats,T", "BIHBI", ("T", 1000)),
        ("TimeMS,GyrX,GyrY", "Iff", ("TimeMS", 1000)),
        ("Status,TimeMS,Week,NSats", "BIHB", None),  # the time of the week alone is no clock of the boot
        ("TimeUS,Value", "ff", None),
    ],
)
def test_the_time_of_the_gps_week_is_never_taken_for_the_boot_clock(columns: str, letters: str, clock: object) -> None:
    fmt: Any = SimpleNamespace(columns=tuple(columns.split(",")), letters=letters)
    assert time_column(fmt) == clock
