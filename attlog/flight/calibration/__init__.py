"""What a firmware makes of a sensor's raw values, and which parameters hold it."""
