"""What came of runs: their numbers, a verdict on the model, medians over many."""
