"""What is to be done with a log, and what became of it."""
