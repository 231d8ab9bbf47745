"""Building blocks of estimators; no block knows an estimator."""
