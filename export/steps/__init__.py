"""Estimators as steps (export/step.py), a file for each kind."""
