"""Foundations of all packages: errors, limits, files, rotations, earth models, worker processes."""
