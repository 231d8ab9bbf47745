"""Hydra's name for runner/progress.py: sweepers have to live in hydra_plugins."""
