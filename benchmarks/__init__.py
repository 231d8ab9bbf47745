"""Speed, memory and peers, measured by hand; never imported by the project."""
