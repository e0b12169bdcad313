"""One log in a process of its own."""
