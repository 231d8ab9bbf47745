"""The simulation: accuracy, cost beside scipy, growth."""
