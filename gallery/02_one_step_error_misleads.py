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
# run*: given the forces alone, what is the whole motion? ``two_point`` is the straight line through
# the last two measured accelerations, ``vwnn`` the network of the paper, ``element_network`` a
# published model of the same frame, whose test motion this is.
import matplotlib.pyplot as plt
import torch

from models.fit.metrics import free_run_score, score
from models.zoo import load_pretrained
from runner import train

settings = {"system": "bilinear", "seed": 0, "baselines": "none", "figures": False}
settings |= {"data.duration": 30.0, "data.calibration_records": 0}  # s; no bands
steps = (0.02, 0.01, 0.005, 0.0025)  # s between two samples of the same motion
runs = {
    (name, dt): train(model=name, **settings, **{"data.dt": dt})
    for name in ("two_point", "vwnn")
    for dt in steps
}
test = runs["vwnn", 0.01].records["test"][0]
models = {
    "two_point": runs["two_point", 0.01].model,
    "vwnn": runs["vwnn", 0.01].model,
    "element_network": load_pretrained("element_network/bilinear").model,
}
for name, model in models.items():
    one, free = score(model, [test]), free_run_score(model, [test])
    simulated = f"{free['relative_rms_percent']:.2f} %" if "diverged" in free else "impossible"
    print(f"{name:16} one step ahead {one['relative_rms_percent']:5.2f} %, free run {simulated}")

# %%
# One step ahead all three look alike, and the line, which knows nothing, errs less than the VWNN.
# In free run the estimates of the VWNN come back as its inputs, and it does not follow the motion.
# The line has no free run at all.
colours = {"two_point": "C2", "vwnn": "C3", "element_network": "C0"}
t, shown = test.dt * torch.arange(test.samples), slice(1000, 1300)
plt.rcParams.update({"font.size": 12, "axes.grid": True, "grid.alpha": 0.3})
figure, axes = plt.subplots(2, figsize=(6.4, 5.6), sharex=True, layout="constrained")
for panel in axes:
    panel.plot(t[shown], test.a[shown, 0], color="0.75", lw=5, label="measured")
    panel.set_ylabel("acceleration [m/s²]")
for name, model in models.items():
    with torch.no_grad():
        axes[0].plot(t[shown], model(test)[shown, 0], "--", color=colours[name], label=name)
        if name != "two_point":
            a = model.free_run(test.drive()).a
            axes[1].plot(t[shown], a[shown, 0], "--", color=colours[name])
axes[0].set_title("One step ahead all look right")
axes[1].set(title="In free run the VWNN is wrong", xlabel="time [s]")
handles, labels = axes[0].get_legend_handles_labels()
figure.legend(handles, labels, loc="outside lower center", ncols=2, fontsize=11, frameon=False)
plt.show()

# %%
# Sampled faster, everything looks better
# ---------------------------------------
# The same motion sampled faster: the line's error falls, though nothing was learned. An error one
# step ahead says as much about the clock as about the model. Before you quote one, compare it with
# the line's.
figure, axes = plt.subplots(figsize=(6.4, 3.8), layout="constrained")
for name, label in (("two_point", "straight line"), ("vwnn", "VWNN")):
    errors = [runs[name, dt].metrics["test"]["relative_rms_percent"] for dt in steps]
    axes.plot([1000 * dt for dt in steps], errors, "o-", color=colours[name], label=label)
    print(
        f"{label}:",
        ", ".join(f"{e:.2f} % at {1000 * dt:g} ms" for e, dt in zip(errors, steps, strict=True)),
    )
axes.set(xlabel="time step [ms]", ylabel="error one step ahead [%]", xlim=0, ylim=0)
axes.set_title("Sampled faster, even a straight line is good")
axes.legend()
plt.show()

# %%
# **What to do.** Ask for the free run of unseen motion, and compare it with that of a plain linear
# model. Every run prints both, and says whether the model simulates: :doc:`/verdict`.
