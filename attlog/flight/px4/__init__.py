"""PX4: which topic means what, in every era, and which setting logs it."""
