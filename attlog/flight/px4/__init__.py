"""Reader of PX4 logs of all versions."""
