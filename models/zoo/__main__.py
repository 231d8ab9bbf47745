"""Published models: what there is, whether it is what it was, and how a run becomes one.

python -m models.zoo list [system=SYSTEM] [model=MODEL]
python -m models.zoo show MODEL/SYSTEM
python -m models.zoo verify [NAME …] [records=FOLDER]
python -m models.zoo publish RUN [MODEL/SYSTEM] [licence=… data_licence=… source=… command=…]
python -m models.zoo page                             writes docs/zoo.md

This is the door alone: whoever publishes and verifies needs runs and reports, which are floors
above. The house behind it is report/zoo/.
"""

from importlib import import_module

if __name__ == "__main__":
    import_module("report.zoo.command").cli(__doc__)
