"""What attitudes are compared with, and how the comparison is made fair."""

from attlog.reference.choose import choose, refuse
from attlog.reference.contradiction import contradicted
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
    "contradicted",
    "heading_references",
    "onboard_rows",
    "refuse",
    "replayed",
    "seen_deg",
]
