"""What every room may use: errors, limits, files, rotations, the earth."""
