"""How choices were made, run by hand; `python -m studies.X --help` says what a study prints."""
