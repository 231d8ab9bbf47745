"""On-line models beside their batch fits.

cases.py   finished runs, and the cases that they make
tables.py  the tables
page.py    docs/online.md from page.md
"""
