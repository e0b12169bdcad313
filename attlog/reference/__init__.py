"""What attitudes are compared with, and how the comparison is made fair."""

from attlog.reference.choose import choose
from attlog.reference.declination import seen_deg
from attlog.reference.model import AlignmentStep, Errors, Reference, Row, Witness
from attlog.reference.options import Options
from attlog.reference.rows import onboard_rows, replayed
from attlog.reference.witnesses import witnesses

__all__ = [
    "AlignmentStep",
    "Errors",
    "Options",
    "Reference",
    "Row",
    "Witness",
    "choose",
    "onboard_rows",
    "replayed",
    "seen_deg",
    "witnesses",
]
