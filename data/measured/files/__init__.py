"""What does a file hold? One reader for each format, each in a file of its own; one table out."""
