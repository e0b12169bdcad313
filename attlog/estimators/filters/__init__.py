"""One file per filter, equations first."""
