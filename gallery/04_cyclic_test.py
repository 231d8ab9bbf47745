"""
A cyclic test: loops, law, C code that runs
===========================================

A brace was pushed and pulled in the laboratory; the files hold its deformation and its force. Which
law is it, with which parameters? And how does it get into a program that knows no Python?
"""

# %%
# Two tests of one brace
# ----------------------
# Stand-ins for files of your own: a steel brace under cycles that grow, to train on, and under an
# irregular history, to test on. The force has 2 % of noise. A file needs columns for time,
# deformation ``s1``, its rate ``s_dot1`` and force ``r1``.
import shutil
import subprocess
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from data import MenegottoPinto
from data.simulation.element_test import force, growing_cycles
from export.write import export
from runner import train

folder, rng, dt = Path(tempfile.mkdtemp()), np.random.default_rng(0), 0.02  # s
steel = {"yield_displacement": 0.006, "stiffness": 4e7, "hardening_ratio": 0.03}  # m, N/m
brace = MenegottoPinto(between=["s1", "x1"], **steel)
t = dt * np.arange(1200)
histories = {
    "growing": growing_cycles(amplitude=0.03, cycles=8, dt=dt, frequency=0.25),  # m, s, Hz
    "irregular": 0.025 * np.sin(1.3 * t) * np.sin(0.2 * t + 0.4 * np.sin(0.7 * t)),
}
for name, y in histories.items():
    r = force(brace, y, dt)
    r += 0.02 * r.std() * rng.standard_normal(y.size)
    table = np.column_stack([dt * np.arange(y.size), y, np.gradient(y, dt), r])
    np.savetxt(
        folder / f"{name}.csv", table, delimiter=",", header="time,s1,s_dot1,r1", comments=""
    )

# %%
# Which law?
# ----------
# Four laws compete. Each is fitted to a part of the first test and judged on the rest; the second
# test is unseen until the end. ``"model.laws": "named"`` would try all that there are.
files = [str(folder / "growing.csv"), str(folder / "irregular.csv")]
laws = ["Bilinear", "MenegottoPinto", "SelfCentering", "Takeda"]
settings = {"data": "measured", "data.path": files, "data.quantity": "force", "model.laws": laws}
run = train(model="element_test", **settings, baselines="none", figures=False)
judged = run.metrics["identification"]["held_out_error_percent_1"]
print("error on held-out motion [%]:", judged)
for p in run.model.physical_parameters():
    true = steel.get(p.name.removeprefix("r1."))
    print(f"{p.name:22} {p.value:10.4g} {p.unit:6}", "" if true is None else f"planted {true:g}")
print(f"error on the unseen test: {run.metrics['free_run']['relative_rms_percent']:.1f} %")

plt.rcParams.update({"font.size": 12, "axes.grid": True, "grid.alpha": 0.3})
figure, panels = plt.subplots(1, 2, figsize=(7.2, 3.8), sharey=True, layout="constrained")
for axes, split, title in zip(panels, ("train", "test"), histories, strict=True):
    record = run.records[split][0]
    model = run.model(record)
    axes.plot(1000 * record.s, record.a / 1000, color="0.7", lw=3, label="measured")
    axes.plot(1000 * record.s, model / 1000, "C3", lw=1, label="identified law")
    axes.set(xlabel="deformation [mm]", ylabel="force [kN]", title=f"{title} ({split})")
figure.suptitle("One law fits the test that it was not fitted to")
panels[0].legend(fontsize=10)
plt.show()

# %%
# The law in C
# ------------
# ``export`` is ``python -m export``. It writes C99 that needs ``math.h`` alone, and a program that
# runs a table through the model. Where there is a C compiler, this page compiles and runs it.
sources = [path for _, path in export(run.folder, ["c"], folder) if path.suffix == ".c"]
print("written:", *(path.name for path in sources))
record = run.records["test"][0]
figure, axes = plt.subplots(figsize=(6.4, 3.8), layout="constrained")
times, python = dt * np.arange(record.samples), run.model(record)[:, 0].numpy()
axes.plot(times, python / 1000, color="0.7", lw=5, label="Python")
if shutil.which("gcc"):
    program = folder / "brace"
    subprocess.run(["gcc", "-std=c99", "-O2", *sources, "-lm", "-o", program], check=True)
    given = np.column_stack([times, record.s, record.s_dot])
    np.savetxt(folder / "in.csv", given, "%.17g", ",", header="time,s1,s_dot1", comments="")
    with open(folder / "in.csv") as file:
        printed = subprocess.check_output([program], stdin=file, text=True).splitlines()
    c = np.loadtxt(printed[1:], delimiter=",")[:, 1]  # columns time and r1
    axes.plot(times, c / 1000, "k--", lw=1, label="C")
    print(f"C and Python differ by {abs(c - python).max() / abs(python).max():.1e} of the peak")
else:
    print("there is no gcc here: the C code is written, and not run")
axes.set(xlabel="time [s]", ylabel="force [kN]", title="The same law in Python and in C")
axes.legend(fontsize=10)
plt.show()

# %%
# **Beware.** A law is chosen among those that were offered: look at the loops, and at the error on
# a test that was not used. The difference of C and Python is a turning point between two samples,
# which C does not see. Targets other than C: :doc:`/export`.
