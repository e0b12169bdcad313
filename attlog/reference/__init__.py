"""Reference attitude of a log, its alignment, and rows measured against it."""

from attlog.reference.alignment import observed_declination_deg
from attlog.reference.choice import choose
from attlog.reference.heading_sources import heading_references
from attlog.reference.model import (
    SMOOTHER,
    AlignmentStep,
    AttitudeErrors,
    HeadingReference,
    Reference,
    ReferenceOptions,
    Track,
)
from attlog.reference.reference_checks import ReferenceCheck
from attlog.reference.scoring import onboard_rows, replayed, withhold
from attlog.reference.smoother import (
    aid_contradicted,
    caveat,
    expected_reference,
    join_segments,
    meaning,
    own_sigma_deg,
    reason_not_smoothed,
    sigma_deg,
    smoothable,
)

__all__ = [
    "SMOOTHER",
    "AlignmentStep",
    "AttitudeErrors",
    "HeadingReference",
    "Reference",
    "ReferenceCheck",
    "ReferenceOptions",
    "Track",
    "aid_contradicted",
    "caveat",
    "choose",
    "expected_reference",
    "heading_references",
    "join_segments",
    "meaning",
    "observed_declination_deg",
    "onboard_rows",
    "own_sigma_deg",
    "reason_not_smoothed",
    "replayed",
    "sigma_deg",
    "smoothable",
    "withhold",
]
