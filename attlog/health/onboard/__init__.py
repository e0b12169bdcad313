"""Checks of the onboard attitude."""
