"""Many logs: each to its files, and what became of them all."""
