"""What happens before any estimator sees a number: structures, excitation, motion, sensors."""
