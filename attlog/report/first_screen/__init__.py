"""What a page shows before anybody scrolls: the strip of the flight, and the four questions in one figure."""
