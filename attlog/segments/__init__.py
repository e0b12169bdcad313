"""Divide a flight into segments: continuous, rest, idling, armed, flight, hover, impact, resets."""

from attlog.segments.build import build
from attlog.segments.model import KINDS, WINDOWS, Segment, Segments

__all__ = ["KINDS", "WINDOWS", "Segment", "Segments", "build"]
