"""Which setting is better, on one log or many: comparisons, sweeps, tuning, differences of results, gates."""
