"""What a format cannot hold is refused with a sentence: each part of a layout by itself."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog import formats
from attlog.base.errors import UsageError
from attlog.formats import MessageLayout, Recording, Text
from attlog.formats.ulog import reader

T = np.arange(3, dtype=np.uint64) * 1000 + 10_000_000


@pytest.mark.parametrize("layout", [{"letters": "Qf"}, {"units": "sm"}, {"multipliers": "F0"}])
def test_a_ulog_has_no_letters_no_units_and_no_multipliers(layout: dict[str, Any], tmp_path: Path) -> None:
    columns = {"timestamp": T, "x": np.zeros(3, np.float32)}
    recording = Recording({("a", 0): columns}, layouts={"a": MessageLayout(**layout)})
    with pytest.raises(UsageError, match="letters, units or multipliers"):
        formats.write(tmp_path / "a.ulg", recording)
    formats.write(tmp_path / "b.ulg", Recording({("a", 0): columns}, layouts={"a": MessageLayout()}))


@pytest.mark.parametrize(("level", "fits"), [(-1, False), (0, True), (7, True), (8, False)])
def test_a_text_has_a_level_from_0_to_7(level: int, fits: bool, tmp_path: Path) -> None:
    recording = Recording(
        {("a", 0): {"timestamp": T, "x": np.zeros(3, np.float32)}}, texts=[Text("said", level, 10_000_000)]
    )
    if fits:
        formats.write(tmp_path / "a.ulg", recording)
        assert [(x.text, x.level) for x in reader.read(tmp_path / "a.ulg").texts] == [("said", level)]
        return
    with pytest.raises(UsageError, match="a level is 0 to 7"):
        formats.write(tmp_path / "a.ulg", recording)
