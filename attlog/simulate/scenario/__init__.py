"""What is simulated: scenarios, their files, their errors."""
