"""Which time a record has, and whether to believe it."""
