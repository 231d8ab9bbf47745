"""
A sweep and its table in pandas
===============================

Does noise change which method is best, and does a setting tuned without noise stay the best one?
Many short runs answer; one table holds every number of all of them, for pandas or whatever you use.
"""

# %%
# Many runs
# ---------
# Every keyword is a setting of the command line. The same sweep on all cores, resumed where it was
# broken off, on a cluster: ``python train.py -m model=vwnn,linear,two_point scenario=noisy
# scenario.level=0,0.05,0.1 'seed=range(3)' hydra/launcher=joblib`` (:doc:`/sweeps`).
import tempfile
from importlib.util import find_spec
from itertools import product
from pathlib import Path

import matplotlib.pyplot as plt

from runner import evaluate, train

folder, levels = Path(tempfile.mkdtemp()), (0.0, 0.05, 0.1)
quick = {"baselines": "none", "figures": False, "data.duration": 20.0}  # s
quick |= {"scenario": "noisy", "data.calibration_records": 0}


def sweep(name, **settings):
    """Train every combination of settings; all numbers of all runs, a table of Arrow."""
    runs = []
    for i, values in enumerate(product(*settings.values())):
        chosen = dict(zip(settings, values, strict=True))
        runs.append(train(**chosen, **quick, folder=folder / name / str(i)))
    return evaluate(runs=runs, output=folder / f"{name}_table").scores


models = ("vwnn", "linear", "two_point")
table = sweep("models", model=models, seed=range(3), **{"scenario.level": levels})
print(f"{table.num_rows} rows with", ", ".join(table.column_names[:14]))

# %%
# One table
# ---------
# It is long: a row for each number, with the choices of its run beside it. So every question is a
# filter and a pivot. pandas is optional; without it, ``table.to_pylist()`` has the same rows.
if find_spec("pandas") is None:
    raise SystemExit("the rest of this example needs pandas: pip install pandas")


def errors(table):
    """Error one step ahead on the test motion [%], a row for each run."""
    rows = table.to_pandas()
    return rows[(rows.split == "test") & (rows.metric == "relative_rms_percent")]


rows = errors(table)
print(rows.pivot_table("value", "model", "scenario.level", aggfunc="median").round(1))

plt.rcParams.update({"font.size": 12, "axes.grid": True, "grid.alpha": 0.3})
figure, axes = plt.subplots(figsize=(6.4, 3.8), layout="constrained")
for model, of_model in rows.groupby("model"):
    over = of_model.groupby("scenario.level").value.agg(["median", "min", "max"])
    axes.plot(100 * over.index, over["median"], "o-", label=model)
    axes.fill_between(100 * over.index, over["min"], over["max"], alpha=0.2)
axes.set(xlabel="noise of the sensors [%]", ylabel="error one step ahead [%]", ylim=0)
axes.set_title("Noise decides which method is best")
axes.legend()
plt.show()

# %%
# Lines are medians over three seeds, bands reach from the smallest to the largest error. The
# straight line through two samples (``two_point``) adds up the noise of both.
#
# A setting against noise
# -----------------------
# The filters of the VWNN have a cut-off frequency. One that is tuned on records without noise is
# not the best for noisy sensors.
cutoffs = (20.0, 50.0, 100.0, 200.0, 300.0)  # rad/s
rows = errors(sweep("cutoffs", **{"model.cutoff": cutoffs, "scenario.level": levels}))
grid = rows.pivot_table("value", "model.cutoff", "scenario.level")
print(grid.round(1))
figure, axes = plt.subplots(figsize=(6.4, 3.8), layout="constrained")
for level in grid.columns:
    axes.plot(grid.index, grid[level], "o-", label=f"{level:.0%} of noise")
axes.set(xlabel="cut-off [rad/s]", ylabel="error one step ahead [%]", ylim=0)
axes.set_title("The best cut-off falls as noise grows")
axes.legend(fontsize=10)
plt.show()

# %%
# **Beware.** An error on the test motion chooses nothing: pick a setting on training motion that
# was held back (``data.validation``), and keep the test for the end.
