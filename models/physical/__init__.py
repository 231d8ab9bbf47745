"""What an identified model holds of physics, and how sure it is of it."""
