"""What does a file hold? One reader and one file for each format; one table out."""
