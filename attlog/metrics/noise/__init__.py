"""What a filter adds to its attitude: at rest, in hover, in flight."""
