"""What runs the filters: samples, start, loop, compiled kernels, batches of parameter sets."""

SOURCES = ("estimators", "kernels", "base/earth.py", "base/errors.py", "base/limits.py", "base/rotation.py")
"""Files below the package that say what a built-in filter's kernel does."""
