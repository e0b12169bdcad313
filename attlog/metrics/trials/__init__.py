"""Filters run again on made samples: do they follow, does gravity correct them, what do they cost?"""
