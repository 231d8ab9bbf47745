"""The public benchmarks of nonlinearbenchmark.org, with their official splits."""
