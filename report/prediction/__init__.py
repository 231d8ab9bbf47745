"""A finished run's model under motions that it has not seen: what it does, and where it may err."""
