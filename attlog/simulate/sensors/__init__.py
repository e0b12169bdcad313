"""One file per sensor: what it measures of a motion, with its errors."""
