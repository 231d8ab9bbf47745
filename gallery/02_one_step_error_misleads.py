"""
Why the error one step ahead misleads
=====================================

Many papers judge a model by how well it estimates the next sample from measured ones. This page
shows that a straight line through two samples, which knows nothing of the structure, passes that
test, and that a model can pass it and be useless as a simulation.
"""

# %%
# Two questions to a model
# ------------------------
# *One step ahead*: given all sensors up to now, what is the acceleration of this sample? *Free
# run*: given the forces alone, what is the whole motion? Published models of a three-storey frame
# that yields answer both, on a motion that was not used in training. ``two_point`` is the straight
# line through the last two measured accelerations.
from dataclasses import replace

import matplotlib.pyplot as plt
import torch

from models import TwoPoint
from models.experiment import Experiment
from models.fit.metrics import free_run_score, score
from models.zoo import load_pretrained

published = {name: load_pretrained(f"{name}/bilinear") for name in ("element_network", "vwnn")}
data = Experiment.of(published["vwnn"].config).make_data()  # that it was trained and tested on
(test,), _ = data.simulation.records("test", count=1, seed=data.seed)
models = {name: one.model for name, one in published.items()}
models["two_point"] = TwoPoint(data.dofs, data.inputs, data.dt)
for name, model in models.items():
    one, free = score(model, [test]), free_run_score(model, [test])
    simulated = f"{free['relative_rms_percent']:.2f} %" if "diverged" in free else "impossible"
    print(f"{name:16} one step ahead {one['relative_rms_percent']:5.2f} %, free run {simulated}")

# %%
# One step ahead all three look alike; the line, which knows nothing, errs less than the VWNN. In
# free run the estimates of the VWNN come back as its inputs, and it does not follow the motion. The
# line has no free run at all.
colours = {"element_network": "C0", "vwnn": "C3", "two_point": "C2"}
t, shown = test.dt * torch.arange(test.samples), slice(1000, 1400)
plt.rcParams.update({"font.size": 12, "axes.grid": True, "grid.alpha": 0.3})
figure, axes = plt.subplots(2, figsize=(6.4, 5.4), sharex=True, sharey=True, layout="constrained")
for panel in axes:
    panel.plot(t[shown], test.a[shown, 0], color="0.75", lw=5, label="measured")
    panel.set_ylabel("acceleration [m/s²]")
for name, model in models.items():
    axes[0].plot(t[shown], model(test)[shown, 0], "--", color=colours[name], label=name)
    if name != "two_point":
        axes[1].plot(t[shown], model.free_run(test.drive()).a[shown, 0], "--", color=colours[name])
axes[0].set_title("One step ahead all look right")
axes[1].set(title="In free run the VWNN is wrong", xlabel="time [s]")
figure.legend(loc="outside lower center", ncols=2, fontsize=11, frameon=False)

# %%
# A faster clock makes everybody better
# -------------------------------------
# The same motion sampled faster: the line's error falls, nearly with the square of the time step,
# though nothing was learned. An error one step ahead says as much about the clock as about the
# model. Before you quote one, compare it with the line's.
steps, errors = (0.02, 0.01, 0.005, 0.0025), []  # s
for dt in steps:
    (faster,), _ = replace(data.simulation, dt=dt).records("test", count=1, seed=data.seed)
    line = TwoPoint(data.dofs, data.inputs, dt)
    errors.append(score(line, [faster])["relative_rms_percent"])
    print(f"a sample every {1000 * dt:4.1f} ms: the straight line errs by {errors[-1]:.2f} %")

figure, axes = plt.subplots(figsize=(6.4, 3.8), layout="constrained")
axes.plot([1000 * dt for dt in steps], errors, "o-", color="C2", label="straight line")
vwnn = score(models["vwnn"], [test])["relative_rms_percent"]
count = models["vwnn"].identified_parameters
axes.plot(1000 * data.dt, vwnn, "s", color="C3", label=f"VWNN, {count} parameters")
axes.set(xlabel="time step [ms]", ylabel="error one step ahead [%]", xlim=0, ylim=0)
axes.set_title("Sampled faster, even a straight line is good")
axes.legend()
plt.show()

# %%
# **What to do.** Ask for the free run of unseen motion, and compare it with that of a plain linear
# model. Every run prints both, and says whether the model simulates: :doc:`/runs`.
