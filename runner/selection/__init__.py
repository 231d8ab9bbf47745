"""Selection of a model: from files to the model that fits them best, and how good it is.

candidates.py  the models that a kind of record allows, the cheapest first
fits.py        their runs, side by side within a budget
identified.py  the choice by held-back motion, the verdict in words, identify.json
search.py      all of it: `identify_records`
"""
