"""A finished run's model under motions that it has not seen: its response, and where it may err."""
