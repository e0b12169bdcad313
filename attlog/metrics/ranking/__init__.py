"""Who is best: one rule for stars, sentences and bars."""
