"""Comparisons and analyses as tables, files and pages."""
