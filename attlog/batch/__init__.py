"""Batch analysis: many logs to reports, an index and one file of numbers."""
