"""One run: its table, its figures, its scores under other conditions."""
