"""A published model as the start of training on a changed structure."""
