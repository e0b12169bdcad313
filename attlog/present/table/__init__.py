"""The table of filters: columns, rows, cells."""
