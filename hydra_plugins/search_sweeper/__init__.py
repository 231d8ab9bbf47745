"""Hydra's name for report/search.py: sweepers have to live in hydra_plugins."""
