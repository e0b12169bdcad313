"""What an onboard estimator is told of its aids: delays, noise, gates, and what it asks of GNSS."""
