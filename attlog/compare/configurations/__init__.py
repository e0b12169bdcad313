"""What is compared: a filter, its gains, and what comes before it."""
