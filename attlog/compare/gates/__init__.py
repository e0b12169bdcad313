"""Limits on the numbers of a result."""
