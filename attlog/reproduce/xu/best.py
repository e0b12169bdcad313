"""Which gain errs least over many flights, and which ones do not differ significantly from it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from attlog.present.numbers import quantity
from attlog.reproduce.judge import above, ratio
from attlog.reproduce.paper import PaperNumber
from attlog.reproduce.xu.runs import SWEPT, gain


@dataclass(frozen=True, slots=True)
class GainErrors:
    """Simulated missions or real flights, as lists by row: RMS in the band by axis in deg, dominant frequencies and
    those of zero crossings in Hz, errors of tilt and heading in deg, NaN where a flight has none."""

    called: str
    rms: Mapping[str, list[tuple[float, float, float]]]
    hz: Mapping[str, list[tuple[float, float, float]]]
    crossing: Mapping[str, list[tuple[float, float, float]]]
    tilt: Mapping[str, list[float]]
    heading: Mapping[str, list[float]]

    @property
    def flights(self) -> int:
        """How many."""
        return len(self.rms[gain(0.6)])

    @property
    def measured(self) -> bool:
        """Whether any flight has an error for every gain."""
        return any(all(math.isfinite(self.tilt[gain(kp)][k]) for kp in SWEPT) for k in range(self.flights))

    def in_band(self, row: str, axis: int) -> list[float]:
        """The RMS of one axis in the band."""
        return [values[axis] for values in self.rms[row]]


@dataclass(frozen=True, slots=True)
class BestGain:
    """The gain with the smallest error of ``what``, those not significantly different, and 0.6's error over its."""

    what: str
    kp: float
    alike: tuple[float, ...]
    over: PaperNumber

    @property
    def tells(self) -> bool:
        """Whether any gain differs significantly from the best."""
        return len(self.alike) < len(SWEPT)

    @property
    def words(self) -> str:
        """In words: ``kp 0.03 to 0.1 gives the smallest error of tilt; 0.6 gives 3.4×``."""
        if not self.tells:
            return f"no gain differs significantly in {self.what} from the best, kp {self.kp:g}"
        span = f"kp {self.alike[0]:g}" + (f" to {self.alike[-1]:g}" if len(self.alike) > 1 else "")
        return f"{span} gives the smallest error of {self.what}; 0.6 gives {quantity(self.over.value, 'ratio')}"

    def any_within(self, low: float, high: float) -> bool:
        """Whether one of the best lies between two gains."""
        return any(low <= kp <= high for kp in self.alike)


def best_gain(runs: GainErrors, errors: Mapping[str, list[float]], what: str) -> BestGain:
    """The best over the flights on which every gain has an error, by the mean logarithm."""
    usable = [k for k in range(runs.flights) if all(math.isfinite(errors[gain(kp)][k]) for kp in SWEPT)]
    found = {kp: [errors[gain(kp)][k] for k in usable] for kp in SWEPT}
    best = min(SWEPT, key=lambda kp: float(np.mean(np.log(found[kp]))) if usable else 0.0)
    alike = tuple(kp for kp in SWEPT if kp == best or above(ratio("", found[kp], found[best]), 1.0) != "holds")
    said = f"error of {what}, kp 0.6 over {best:g}, the best, {runs.called}"
    return BestGain(what, best, alike, ratio(said, found[0.6], found[best]))
