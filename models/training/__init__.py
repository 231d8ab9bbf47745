"""Config → data, estimator, solver and objective of a run."""
