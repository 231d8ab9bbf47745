"""Searches → what careful tuning gives on fresh seeds: `python -m report.tuning`."""

from report.tuning.cases import main

if __name__ == "__main__":
    main()
