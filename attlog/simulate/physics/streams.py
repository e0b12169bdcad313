"""Random numbers: one independent generator for each thing that is random.

Each is spawned from the flight's seed by a key of names, so adding a sensor or drawing
more numbers from one changes nothing in another.
"""

from __future__ import annotations

import numpy as np


def generator(seed: int, *key: str | int) -> np.random.Generator:
    """The generator of a thing such as ``("imu", 0, "gyro")`` in the flight ``seed``."""
    numbers = tuple(k if isinstance(k, int) else int.from_bytes(k.encode(), "big") for k in key)
    words = tuple(w for n in numbers for w in (n.bit_length(), *_words(n)))
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=words))


def _words(number: int) -> list[int]:
    """A number as 32-bit words, the lowest first."""
    return [(number >> shift) & 0xFFFFFFFF for shift in range(0, max(number.bit_length(), 1), 32)]
