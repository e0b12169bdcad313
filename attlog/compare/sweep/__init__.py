"""A grid of settings: the best, and what cannot be distinguished from it."""
