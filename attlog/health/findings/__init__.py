"""What is wrong with a log, and what to do about it: one finding for each cause."""

from attlog.health.findings.finding import Finding, Weight
from attlog.health.findings.listing import ABOUT, OpenQuestion, contradiction, findings, unusable
from attlog.health.findings.record import nothing_wrong

__all__ = ["ABOUT", "Finding", "OpenQuestion", "Weight", "contradiction", "findings", "nothing_wrong", "unusable"]
