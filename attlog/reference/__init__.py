"""What attitudes are compared with, and how the comparison is made fair."""

from attlog.reference.choose import choose
from attlog.reference.declination import measured_deg
from attlog.reference.heading_references import heading_references
from attlog.reference.meaning import caveat, meaning, own_sigma_deg
from attlog.reference.model import AlignmentStep, AttitudeErrors, HeadingReference, Reference, ReferenceOptions, Row
from attlog.reference.physics.contradiction import ReferenceCheck, contradicted
from attlog.reference.rows import onboard_rows, replayed, withhold
from attlog.reference.smoothed import NAME as SMOOTHER
from attlog.reference.smoothed import expected_reference, joined, not_smoothed, sigma_deg, smoothable

__all__ = [
    "SMOOTHER",
    "AlignmentStep",
    "AttitudeErrors",
    "HeadingReference",
    "Reference",
    "ReferenceCheck",
    "ReferenceOptions",
    "Row",
    "caveat",
    "choose",
    "contradicted",
    "expected_reference",
    "heading_references",
    "joined",
    "meaning",
    "measured_deg",
    "not_smoothed",
    "onboard_rows",
    "own_sigma_deg",
    "replayed",
    "sigma_deg",
    "smoothable",
    "withhold",
]
