"""Parameters of the vehicle: their history, files of them, their limits."""
