"""What a batch shows: its index, its tables, its summary."""
