"""Which setting is better, on one log or on twenty: comparisons, sweeps, tuning, and what changed between two runs."""
