"""What four papers found, run again: one file per paper, each a list of claims with a verdict and its numbers."""
