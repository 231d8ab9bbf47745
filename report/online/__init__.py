"""On-line models beside their batch fits."""
