"""Models whose weights adapt sample by sample."""
