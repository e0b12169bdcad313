"""What runs the filters: samples, start, loop, compiled kernels, batches of parameter sets."""
