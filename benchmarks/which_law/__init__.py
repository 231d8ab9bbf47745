"""Which law has an element? Picks among classes, counted over simulated noisy element tests."""
