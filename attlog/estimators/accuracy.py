"""How far filters are from the truth on public data: what ``benchmarks/accuracy.py --write`` measured.

``accuracy.csv`` holds a line for each filter (or package beside them) and set:

======================== ==================================================================================
set                      recordings
======================== ==================================================================================
``broad``                BROAD [Laidig2021]: 9-axis IMU, optical truth; motion phases
``euroc``                EuRoC [Burri2016]: quadrotor without magnetometer; after 20 s, tilt only
``simulated``            ArduPilot and PX4 SITL flights; after 15 s, GNSS for filters that use it
``simulated_unbiased``   the same, the gyro's bias at rest subtracted as in an analysis
======================== ==================================================================================

A number is the mean RMSE over the trials. Its 95 % interval is m exp(+-q s / (m sqrt(n))), the mean m of n trials with
standard deviation s and Student's quantile q of n - 1 degrees of freedom: that of log m by the delta method.
"""

from __future__ import annotations

import csv
import functools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

FILE = Path(__file__).with_name("accuracy.csv")
# The sets by the names that the file has, with the words that people see.
SETS = {
    "broad": "BROAD",
    "euroc": "EuRoC",
    "simulated": "simulated",
    "simulated_unbiased": "simulated, gyro bias subtracted",
}
ANGLES = ("total", "heading", "tilt")
NOT_MEASURED = "not measured"


@dataclass(frozen=True, slots=True)
class MeanRmse:
    """A mean over trials in deg with its 95 % interval, None of a single trial."""

    value: float
    low: float | None
    high: float | None


@dataclass(frozen=True, slots=True)
class FilterAccuracy:
    """Errors of one filter on one set.

    ``rmse_deg`` by angle, without angles that the set does not show; ns per update (median over trials); version of
    attlog and date of the measurement.
    """

    trials: int
    rmse_deg: Mapping[str, MeanRmse]
    ns: float
    version: str
    date: str

    def short(self) -> str:
        """Total/heading/tilt in deg, or the one angle that there is."""
        return "/".join(f"{self.rmse_deg[a].value:.1f}" for a in ANGLES if a in self.rmse_deg)


@functools.cache
def read_accuracy() -> Mapping[str, Mapping[str, FilterAccuracy]]:
    """Filter -> set -> what was measured, in the order of the file."""
    found: dict[str, dict[str, FilterAccuracy]] = {}
    with FILE.open(encoding="utf-8", newline="") as file:
        for line in csv.DictReader(file):
            found.setdefault(line["filter"], {})[line["set"]] = _of_line(line)
    return found


def _of_line(line: Mapping[str, str]) -> FilterAccuracy:
    def number(name: str) -> float | None:
        return float(line[name]) if line[name] else None

    rmse = {
        angle: MeanRmse(value, number(f"{angle}_low"), number(f"{angle}_high"))
        for angle in ANGLES
        if (value := number(angle)) is not None
    }
    return FilterAccuracy(int(line["trials"]), rmse, float(line["ns"]), line["version"], line["date"])
