"""How far a row is from the reference, when it converges, how it recovers."""
