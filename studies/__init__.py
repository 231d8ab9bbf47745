"""How choices were made; run by hand."""
