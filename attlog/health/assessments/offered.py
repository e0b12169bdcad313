"""What should be set, all questions about a log together? Each parameter once, and none that two questions dispute."""

from __future__ import annotations

from collections.abc import Iterable
from math import isclose

from attlog.health.assessments.model import Assessment, Setting

SAME = 1e-6
"""Values that differ by this share are equal: logs and files hold parameters as 32 bit floating point."""


def offered(assessments: Iterable[Assessment]) -> list[Setting]:
    """The parameters to set, in the order of the questions.

    One that two questions would set to different values is left out: one of them is wrong. So are all others of those
    questions, because offsets and scales only fit together.
    """
    given = [assessment.settings for assessment in assessments if assessment.settings]
    values: dict[str, list[float]] = {}
    for settings in given:
        for setting in settings:
            values.setdefault(setting.name, []).append(setting.new)
    disputed = {name for name, new in values.items() if any(not isclose(x, new[0], rel_tol=SAME) for x in new)}
    agreed = [settings for settings in given if disputed.isdisjoint(setting.name for setting in settings)]
    found: dict[str, Setting] = {}
    for settings in agreed:
        for setting in settings:
            found.setdefault(setting.name, setting)
    return list(found.values())


def number_text(value: float) -> str:
    """A parameter's value as a ground station takes it: seven digits, as many as 32 bit floating point holds."""
    return f"{value + 0.0:.7g}"


def sentence(settings: Iterable[Setting]) -> str:
    """What to set as one sentence, empty without: ``Set COMPASS_OFS_X 145, COMPASS_OFS_Y -20.``"""
    words = ", ".join(f"{setting.name} {number_text(setting.new)}" for setting in settings)
    return f"Set {words}." if words else ""
