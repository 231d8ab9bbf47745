"""What is in a file, before anything is fitted? `python -m data.inspect record.csv` shows it."""
