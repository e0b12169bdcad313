"""Parameters to set: from a sensor's error to the firmware's own names, and files of them."""
