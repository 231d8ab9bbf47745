"""Fitting and scoring any estimator."""
