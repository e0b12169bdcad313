"""Can the accelerometers and gyros be trusted: offsets, scale, temperature, and one unit against another?"""
