"""What do the public benchmarks hold? Their files, official splits, metrics, published errors."""
