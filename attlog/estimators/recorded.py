"""An attitude that somebody computed elsewhere, as an estimator's name: ``estimate.csv[:frame=enu-flu,offset=1.5]``.

Such a name has parameters like any other, but cannot be run on samples: its file is read beside the log it
belongs to (:mod:`attlog.recorded`).
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, NoReturn

from attlog.base.errors import UsageError
from attlog.estimators.base import Estimator, Parameter

SUFFIX = ".csv"
FRAMES = ("auto", "ned-frd", "enu-flu", "ned-flu", "enu-frd", "frd-ned", "flu-enu")
PARAMETERS = (
    Parameter(
        "offset",
        0.0,
        "s",
        -1e10,
        1e10,
        "added to its times to be on the log's clock, 0 the first IMU sample; "
        "0: found among the clocks that the log knows",
        "the user",
    ),
    Parameter(
        "delay",
        0.0,
        "ms",
        -1000,
        1000,
        "known delay of the sensors it was computed from, subtracted from its lag; the logged IMU's is not its own",
        "the user",
    ),
    Parameter(
        "frame",
        "auto",
        "",
        0,
        1,
        "earth-body axes of its rotation from body to earth, or body-earth of its "
        "inverse; auto: what gyro and gravity agree with",
        "the user",
        FRAMES,
    ),
    Parameter(
        "angles",
        "auto",
        "",
        0,
        1,
        "unit of Euler angles; auto: by the column's name, else by the gyro",
        "the user",
        ("auto", "deg", "rad"),
    ),
    Parameter(
        "north",
        "yes",
        "",
        0,
        1,
        "no: its heading has no north of its own, its offset is taken out",
        "the user",
        ("yes", "no"),
    ),
)


def is_recorded(name: str) -> bool:
    """Whether a name is that of a file with an attitude."""
    return name.lower().endswith(SUFFIX)


def from_file(path: Path) -> Estimator:
    """The name of a file with an attitude, as an estimator that cannot be run on samples. UsageError without it."""
    if not os.path.isfile(path):
        raise UsageError(f"{path}: there is no such file with an attitude")

    def run(*_: Any) -> NoReturn:
        raise UsageError(f"{path}: holds an attitude that was computed elsewhere; it cannot be run on samples")

    nothing: frozenset[str] = frozenset()
    title = f"Attitude computed elsewhere, read from {path.name}"
    return Estimator(path.stem, title, "", "", nothing, nothing, PARAMETERS, {}, run=run, origin=str(path))
