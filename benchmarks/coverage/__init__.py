"""Do intervals hold the truth? Counted over simulated noisy records."""
