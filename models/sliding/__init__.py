"""A mass that slides: its exact run between corners and its derivatives; start and training."""
