"""Strange calls of the library: arguments, records, and what is done with them."""
