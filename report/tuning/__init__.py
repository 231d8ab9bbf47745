"""What careful tuning gives each method."""
