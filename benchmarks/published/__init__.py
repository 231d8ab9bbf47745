"""Published packages on the records of the zoo; `python -m benchmarks.published`."""
