"""A log's bytes go with its messages at once: those that wait for the collector of cycles are held twice."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest

from attlog import formats
from tests.conftest import SAMPLES, few


@pytest.mark.parametrize("name", few(["px4_steps.ulg", "copter_yaw_turns.bin", "copter_steps_stabilize.tlog"], 1))
def test_the_bytes_of_a_log_are_let_go_of_with_its_messages(monkeypatch, name):
    read, seen = np.fromfile, []

    def noted(*args, **options):
        data = read(*args, **options)
        seen.append(weakref.ref(data))
        return data

    monkeypatch.setattr(np, "fromfile", noted)
    gc.collect()
    gc.disable()
    try:
        messages = formats.open(SAMPLES / name)
        assert messages.size
        assert [data() is not None for data in seen] == [True]
        del messages
        assert [data() for data in seen] == [None]
    finally:
        gc.enable()
