"""Which setting is better, on one log or on twenty: comparisons, sweeps, tuning, and what changed between two runs."""


# What is compared: a filter, its gains, and what comes before it.

# Paired differences on one log, pooled over many.

# A grid of settings: the best, and what cannot be distinguished from it.

# Gains found on some logs and judged on others.

# Comparisons and analyses as tables, files and pages.

# Limits on the numbers of a result.

# What changed between two runs.
