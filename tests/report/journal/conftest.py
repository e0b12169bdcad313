"""The figures of a made flight, drawn once."""

from __future__ import annotations

from typing import Any

import pytest

from attlog.report.journal.pictures import Album
from tests.report.conftest import NAMES, make_result


@pytest.fixture(scope="package")
def album() -> Album:
    """The figures of a flight with three filters."""
    return Album.of(make_result(NAMES[:3]))


@pytest.fixture(scope="package")
def drawn(album: Album) -> dict[str, dict[str, Any]]:
    """All of them, data and layout."""
    return {name: album.drawn(name) for name in album.found}
