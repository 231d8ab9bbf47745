"""The zoo: one estimator per file, each a plain nn.Module that knows no Lightning."""
