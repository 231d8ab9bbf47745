"""Hydra's name for report/batch.py: launchers have to live in hydra_plugins."""
