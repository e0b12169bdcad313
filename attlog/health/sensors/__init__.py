"""Checks of each sensor."""
