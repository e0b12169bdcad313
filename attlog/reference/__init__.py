"""What attitudes are compared with, and how the comparison is made fair."""

from attlog.reference.choose import choose
from attlog.reference.declination import seen_deg
from attlog.reference.heading_references import heading_references
from attlog.reference.model import AlignmentStep, Errors, HeadingReference, Reference, Row
from attlog.reference.options import Options
from attlog.reference.rows import onboard_rows, replayed

__all__ = [
    "AlignmentStep",
    "Errors",
    "HeadingReference",
    "Options",
    "Reference",
    "Row",
    "choose",
    "heading_references",
    "onboard_rows",
    "replayed",
    "seen_deg",
]
