"""What do GNSS and gravity say of an attitude, without a filter: numbers only."""
