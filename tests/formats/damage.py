"""Files damaged on purpose, with the memory of where every byte came from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass
class Damaged:
    """Bytes of a log and for each its offset in the undamaged file, -1 for a foreign byte."""

    data: NDArray[np.uint8]
    source: NDArray[np.int64]

    @classmethod
    def of(cls, raw: bytes) -> Damaged:
        return cls(np.frombuffer(raw, np.uint8).copy(), np.arange(len(raw)))

    def overwrite(self, at: int, block: bytes) -> None:
        stop = min(at + len(block), len(self.data))
        self.data[at:stop] = np.frombuffer(block, np.uint8)[: stop - at]
        self.source[at:stop] = -1

    def insert(self, at: int, block: bytes) -> None:
        self.data = np.insert(self.data, at, np.frombuffer(block, np.uint8))
        self.source = np.insert(self.source, at, np.full(len(block), -1))

    def delete(self, at: int, count: int) -> None:
        self.data = np.delete(self.data, slice(at, at + count))
        self.source = np.delete(self.source, slice(at, at + count))

    def whole(self, offsets: NDArray[np.int64], lengths: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which records of the undamaged file are still whole, by their offsets and lengths there."""
        place = np.full(int((offsets + lengths).max()) + 1, -1)
        present = np.flatnonzero((self.source >= 0) & (self.source < len(place)))
        place[self.source[present]] = present
        first, last = place[offsets], place[offsets + lengths - 1]
        # how many bytes up to each one do not follow the byte before
        breaks = np.concatenate([[0], np.cumsum((np.diff(self.source) != 1) | (self.source[1:] < 0))])
        return (first >= 0) & (last - first == lengths - 1) & (breaks[last] == breaks[first])


KINDS = ("garbage over", "garbage between", "zeros", "erased flash", "cut out", "flipped bits")


def damage(raw: bytes, kind: str, places: int, rng: np.random.Generator, size: int = 3000, keep: int = 0) -> Damaged:
    """The file with so many damaged places of one kind, none before the byte ``keep``."""
    log = Damaged.of(raw)
    for at in sorted(rng.integers(keep, len(raw) - size, places).tolist(), reverse=True):
        length = int(rng.integers(1, size))
        match kind:
            case "garbage over":
                log.overwrite(at, rng.bytes(length))
            case "garbage between":
                log.insert(at, rng.bytes(length))
            case "zeros":
                log.overwrite(at, bytes(length))
            case "erased flash":
                log.overwrite(at, b"\xff" * length)
            case "cut out":
                log.delete(at, length)
            case "flipped bits":
                log.overwrite(at, bytes([int(log.data[at]) ^ (1 << int(rng.integers(8)))]))
    return log
