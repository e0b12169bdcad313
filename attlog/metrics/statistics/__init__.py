"""Intervals, quantiles, and tests of differences."""
