"""Faults of sensors fitted over a flight: scale, axes, offset and mounting, each with its 95 % interval."""
