"""Hydra's name for report/sweep.py: sweepers have to live in hydra_plugins."""
