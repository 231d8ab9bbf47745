"""Models that learn sample by sample."""
