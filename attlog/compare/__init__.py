"""Find the better setting on one log or many: comparisons, sweeps, tuning, gates."""
