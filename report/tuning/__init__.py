"""What careful tuning gives each method.

cases.py   finished searches, with the scores of their runs on fresh seeds
onset.py   these runs scored again without the first second, a command of its own
tables.py  the tables
page.py    docs/tuning.md from page.md
"""
