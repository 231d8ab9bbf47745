"""Finished runs of on-line models → the tables of docs/online.md: `python -m report.online`."""

from report.online.cases import main

if __name__ == "__main__":
    main()
