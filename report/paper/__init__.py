"""The paper's tables and figures, with ours and the paper's values."""
