"""A file of parameters that a ground station loads: one line each, its old value as a comment."""

from __future__ import annotations

from attlog.health.assessments.model import Setting


def param_file(firmware: str, log_name: str, settings: list[Setting]) -> str:
    """The text of the file for a vehicle with ``firmware``; what names the log stands in comments."""
    head = " ".join(f"Proposed from {log_name} ({firmware})".split())
    lines = [f"# {head}", "# Valid only where the vehicle still has the old values."]
    for one in settings:
        was = "was not logged" if one.old is None else f"was {one.old:.9g} when the log was flown"
        lines += [f"# {one.name} {was}", f"{one.name},{one.new:.9g}"]
    return "\n".join(lines) + "\n"
