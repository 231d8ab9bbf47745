"""Public benchmarks' stand-ins: simulated systems in the files and layouts of the real ones."""
