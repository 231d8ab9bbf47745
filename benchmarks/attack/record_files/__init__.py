"""Files of records to attack with: every format, good, with odd content, and damaged."""
