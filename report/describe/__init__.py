"""What a finished run's model is, in words and numbers with units."""
