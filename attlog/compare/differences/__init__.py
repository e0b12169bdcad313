"""Paired differences on one log, pooled over many."""
