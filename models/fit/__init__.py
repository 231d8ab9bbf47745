"""Training and scoring of any estimator."""
