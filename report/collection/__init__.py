"""Any runs: one reader, one long table, comparisons."""
