"""What lies in a run's folder, in which order it is written, and who may write."""
