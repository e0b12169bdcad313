"""Arrays as they are, in place of what travels in a page."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.report.pack import Store

Array = NDArray[np.float64]


class PlainStore(Store):
    """A store that puts nothing away: what it returns holds the array itself."""

    def values(self, y: Array, step: float = 1e-9) -> dict[str, Any]:
        """The array; ``step`` is of no concern."""
        return {"array": y}

    def times(self, t: Array) -> dict[str, Any]:
        """The times."""
        return {"array": t}


def array(stored: Any) -> Array:
    """What a figure's data hold as an array: from the store, or a list in which None is missing."""
    return np.asarray(stored["array"] if isinstance(stored, dict) else stored, np.float64)
