"""Names of rows, heading references, references, and codes of missing answers."""

from __future__ import annotations

import re

from attlog.result import Duplicates, EstimatorRow, Result
from attlog.words.numbers import listed, quantity

# Words written in capitals.
ABBREVIATIONS = frozenset({"ahrs", "ap", "dcm", "ekf", "eskf", "gnss", "gsf", "imu", "marg", "mekf", "px4", "q"})

# Origins of a parameter set by the user: an option, or a ground station's file.
SET_BY_HAND = ("option", "file")


def row_name(row: EstimatorRow) -> str:
    """Return a row's name, derived from its id: ``Mahony, Xu 0.6``, ``Onboard (ATT)``."""
    return _named(row, ", ")


def name_in_sentence(row: EstimatorRow) -> str:
    """Return the name without commas, for lists of names: ``Mahony Xu 0.6``, ``Onboard``."""
    return "Onboard" if row.name == "onboard" else _named(row, " ")


def flown_name(estimator: str) -> str:
    """Return the firmware's name of a re-run filter: ``EKF2`` for ``px4_ekf2``."""
    return estimator.partition(":")[0].rpartition("_")[2].upper()


def row_names(result: Result) -> dict[str, str]:
    """Return the name of every row by id; equal names include the id."""
    names = {row.name: row_name(row) for row in result.estimators}
    called = list(names.values())
    return {key: name if called.count(name) == 1 else f"{name} [{key}]" for key, name in names.items()}


def _named(row: EstimatorRow, comma: str) -> str:
    if row.kind == "onboard":
        _, _, other = row.name.partition(":")
        return f"Onboard {other}" if other else f"Onboard ({row.title})" if row.title else "Onboard"
    base, slash, imu = row.name.rpartition("/imu")
    base = base if slash else row.name
    known = row.estimator or base
    if known == row.name:
        known = base.partition(":")[0].partition("@")[0]
    preset = row.preset or ""
    again = [f"{flown_name(row.estimator)} re-run"] if row.kind == "rerun" else []
    parts = again or [_spelled(re.split(r"[_\s]+", known), row.title)]
    if preset:
        parts.append(_spelled(preset.replace("_", "-").split("-"), ""))
    if slash:
        parts.append(f"IMU {imu}")
    by_hand = [f"{key} {short_value(p.value)}" for key, p in row.parameters.items() if p.origin in SET_BY_HAND]
    return comma.join(parts) + (f" ({', '.join(by_hand) if comma != ' ' else ' '.join(by_hand)})" if by_hand else "")


def short_value(value: float | str) -> str:
    """Format a parameter's value."""
    return f"{value:g}" if isinstance(value, float | int) else str(value)


def _spelled(words: list[str], title: str) -> str:
    """Spell the words of an id as in the title, abbreviations in capitals."""
    spelled = {w.lower(): w for w in re.findall(r"\w+", title)}
    written = []
    for word in words:
        letters = word.rstrip("0123456789")
        capital = word.upper() if {word.lower(), letters.lower()} & ABBREVIATIONS else word
        written.append(spelled.get(word.lower(), capital))
    text = " ".join(written)
    return text[:1].upper() + text[1:]


# Heading reference: as column heading, and after "against".
HEADING_REFERENCE = {
    "rest": ("rest", "standing still"),
    "truth": ("truth", "the truth"),
    "smoother": ("smoother", "the smoother"),
    "onboard": ("onboard", "onboard"),
    "gnss_yaw": ("GNSS yaw", "the GNSS heading"),
    "mag": ("mag", "the magnetometer"),
    "yaw_estimator": ("yaw estimator", "the onboard yaw estimator"),
    "course": ("GNSS course", "the GNSS course"),
}

# Reference name of differences from the autopilot's own attitude.
AGREEMENT = "onboard (agreement, not truth)"


def heading_reference_short(reference: str) -> str:
    """Return a heading reference as column heading."""
    return HEADING_REFERENCE.get(reference, (reference, ""))[0]


def heading_reference_name(reference: str) -> str:
    """Return a heading reference as it follows "against"."""
    return HEADING_REFERENCE.get(reference, ("", reference))[1]


# Checks whose failure casts doubt on a heading reference.
DOUBTS = {
    "onboard": {
        "heading_by_gnss": "GNSS contradicts it",
        "attitude_jumps": "it jumps",
        "second_source": "another source differs",
    },
    "mag": {
        "field": "its field is wrong",
        "compass_orientation": "it is mounted otherwise than set",
        "compass_offset": "it is off",
        "compass_motors": "motors disturb it",
    },
}


def truth_name(result: Result) -> str:
    """Return "the logged truth" or "your truth"."""
    return "the logged truth" if result.reference is None or result.reference.fit is None else "your truth"


def against_heading(result: Result, reference: str) -> str:
    """Return a heading reference after "against", with a warning if it is no truth."""
    name = truth_name(result) if reference == "truth" else heading_reference_name(reference)
    return f"{name} ({heading_warning(result, reference)})" if reference in DOUBTS else name


def heading_warning(result: Result, reference: str) -> str:
    """Return the warning on a heading reference: a failed check, else "agreement, not truth"."""
    least = ("fault",) if reference == "onboard" else ("fault", "warning")
    failed = {check.question for check in result.checks if check.verdict in least and check.in_use}
    doubt = next((words for name, words in DOUBTS[reference].items() if name in failed), "")
    return f"in doubt: {doubt}" if doubt else "agreement, not truth"


# Title of errors against the onboard attitude.
AGREEMENT_TITLE = "Agreement with onboard"


def is_against_onboard(result: Result) -> bool:
    """Return whether errors are against the onboard attitude: agreement, no accuracy."""
    return result.reference is not None and result.reference.choice == "onboard"


def against_whom(result: Result, *, sigma: bool = False) -> str:
    """Return the reference, with a warning if it is no truth.

    ``sigma``: append its own tilt sigma.
    """
    reference = result.reference
    choice = reference.choice if reference else ""
    whom = {"truth": truth_name(result), "smoother": "the smoother"}.get(choice, AGREEMENT)
    own = reference.sigma_tilt_deg if reference is not None and sigma else None
    return f"{whom} (sigma {quantity(own, 'deg', signed=False)})" if own else whom


# Cell text of a missing value by code, and its form in at most 9 letters.
CODES = {
    "no_rest": ("no rest", "no rest"),
    "rest_too_short": ("rest too short", "short"),
    "no_reference": ("no reference", "no ref"),
    "reference_too_slow": ("reference slow", "slow ref"),
    "reference_diverged": ("reference diverged", "ref lost"),
    "no_events": ("no steps", "no steps"),
    "too_few_events": ("few steps", "few steps"),
    "no_magnetometer": ("no mag", "no mag"),
    "no_setpoint": ("no set-point", "no set"),
    "no_gnss": ("no GNSS", "no GNSS"),
    "not_converged": ("not converged", "unsettled"),
    "diverged": ("diverged", "diverged"),
    "not_a_pure_delay": ("undefined", "unclear"),
    "not_covered": ("not covered", "uncovered"),
    "clock_unknown": ("clock unknown", "no clock"),
    "not_applicable": ("n/a", "n/a"),
    "did_not_move": ("did not move", "no move"),
    "lag_at_edge": ("undefined", "unclear"),
    "rate_too_low": ("rate too low", "low rate"),
    "record_too_short": ("too short", "short"),
    "too_uncertain": ("too uncertain", "unsure"),
    "part_failed": ("failed", "bug"),
}

# Codes and states as remarks in brackets after names.
NOT_JUDGED = {
    "not_a_pure_delay": "wrong angle in the step",
    "lag_at_edge": "wrong angle in the step",
    "too_few_events": "too few steps",
    "not_covered": "not comparable",
    "too_uncertain": "too uncertain",
    "diverged": "diverged",
    "not_converged": "did not settle",
    "failed": "failed",
    "not_judged": "not judged",
}


# Rows of the same filter, as a sentence.


def duplicate_rows_text(result: Result, equations: bool = True) -> list[str]:
    """Return one sentence per group of rows with one equation or equal attitudes.

    ``equations`` False: only groups with equal attitudes.
    """
    names = {row.name: name_in_sentence(row) for row in result.estimators}
    return [
        duplicate_sentence(group, [names.get(row, row) for row in group.rows])
        for group in result.alike
        if equations or group.by == "attitudes"
    ]


def duplicate_sentence(group: Duplicates, names: list[str]) -> str:
    """Return the sentence for one group."""
    which = listed(names)
    values = [f"{name} ({', '.join(map(short_value, own))})" for name, own in group.differ.items()]
    if group.by == "attitudes":
        but = f" in spite of {listed(values)}" if values else ""
        return f"{which} give the same attitudes in this log{but}: here they are one filter."
    differ = f" and differ in {listed(values)}" if values else ""
    return f"{which} share one equation ({group.source}){differ}."
