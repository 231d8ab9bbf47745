"""
Damage: has the structure changed?
==================================

A frame was measured when it was sound. After an event it is measured again, under another motion.
Did it change, where, and by how much? The same question is asked of a frame that did not change: a
method that always finds something is useless.
"""

# %%
# Before and after
# ----------------
# A four-storey laboratory frame under random forces. Accelerations with 5 % of noise are all that
# is measured. Later records are of frames whose second storey has lost a share of its stiffness and
# strength, from nothing to a fifth, each under a motion of its own. With files of your own this is
# ``python evaluate.py run=FOLDER data.path=after.csv change=true``.
import matplotlib.pyplot as plt

from models.uncertainty.change import compare
from runner import train

LOSSES = (0.0, 0.01, 0.02, 0.05, 0.2)
frame = {"system": "shear_frame", "excitation.force.std": 20.0, "data.duration": 15.0}  # N, s
frame |= {"scenario": "noisy", "scenario.level": 0.05, "data.calibration_records": 0}
frame |= {"baselines": "none", "figures": False}
laws = {"model.elements": "chain", "model.hinges": 0, "model.units": 1, "model.cubic": False}
laws |= {"model.rounded": False, "model/reads": "accelerations"}
before = train(model="element_network", **frame, **laws)
after = {}
for seed, loss in enumerate(LOSSES, start=1):
    storey = {"stiffness": 20e3 * (1 - loss), "post_yield_stiffness": 10e3 * (1 - loss)}  # N/m
    damaged = {f"system.structure.elements.r2.{name}": value for name, value in storey.items()}
    after[loss] = train(model="linear", seed=seed, **frame, **damaged).records["test"]

# %%
# The comparison
# --------------
# ``compare`` fits the model of before to the records of after, beginning where it is, and holds
# stiffness, damping and yield force of every storey against no change, all together, so that one
# undamaged frame in twenty is called changed.
model, known = before.stored.restore(), [*before.records["train"], *before.records["test"]]
found = {loss: compare(model, known, records) for loss, records in after.items()}
for loss, comparison in found.items():
    said = [f"{one.name} times {one.factor:.3f}" for one in comparison.changed]
    print(f"lost {loss:4.0%} of storey 2:", "; ".join(said) or "no change beyond what records tell")

# sphinx_gallery_thumbnail_number = 2
plt.rcParams.update({"font.size": 12, "axes.grid": True, "grid.alpha": 0.3})
figure, panels = plt.subplots(
    1, 2, figsize=(7.2, 4.8), sharey=True, sharex=True, layout="constrained"
)
for axes, loss in zip(panels, (0.0, 0.2), strict=True):
    rows = sorted(found[loss].changes, key=lambda one: one.name.split(".")[::-1])
    for row, one in enumerate(rows):
        colour = "C3" if one.changed else "C0"
        axes.plot([one.low, one.high], [row, row], colour, lw=2)
        axes.plot(one.factor, row, "o", color=colour)
    axes.axvline(1, color="k", lw=1)
    axes.set_yticks(
        range(len(rows)), [one.name.replace("_", " ").replace(".", " ") for one in rows]
    )
    axes.set(xlabel="after over before [–]", title=f"{loss:.0%} lost in storey 2")
figure.suptitle("Red: changed; blue: no more than the records leave open")
plt.show()

# %%
# How small a loss is found?
# --------------------------
figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
for loss, comparison in found.items():
    one = next(one for one in comparison.changes if one.name == "r2.stiffness")
    lost, error = (
        100 * (1 - one.factor),
        [[100 * (one.high - one.factor)], [100 * (one.factor - one.low)]],
    )
    axes.errorbar(
        100 * loss, lost, yerr=error, fmt="o", color="C3" if one.changed else "C0", capsize=3
    )
axes.plot([0, 20], [0, 20], "k:", label="planted")
axes.set(xlabel="planted loss of stiffness [%]", ylabel="found loss, 95 % interval [%]")
axes.set_title("Storey 2: red is called changed")
axes.legend()
plt.show()

# %%
# **Beware.** The law of the frame is among those of the model, both records hold motion beyond the
# yield point, and nothing else differs. Temperature, another sensor or a law that the model lacks
# look like changes: :doc:`/change`. Alarms while the structure moves: :doc:`/detection`.
