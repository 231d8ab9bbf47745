"""What estimators are built from; knows no estimator."""
