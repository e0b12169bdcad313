"""Arrays for the figures of the report."""
