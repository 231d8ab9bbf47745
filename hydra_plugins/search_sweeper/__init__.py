"""Hydra's name for runner/search.py: sweepers have to live in hydra_plugins."""
