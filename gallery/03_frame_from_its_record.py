"""
A frame from its record: law, stiffness, yield points, intervals
================================================================

A four-storey frame is shaken by known forces; accelerometers on its floors are noisy, and nothing
else is measured. This page finds masses, stiffnesses, dampers and yield points of all storeys, with
95 % intervals, and compares them with those that the simulation had.
"""

# %%
# From accelerations to parameters
# --------------------------------
# The model is a chain of storeys, each a spring, a damper and an elastoplastic unit: a bilinear
# storey. ``model/reads=accelerations`` says that displacements and velocities are not looked at.
# With records of your own, ``data="measured"`` and ``data.path`` take the place of the system.
import matplotlib.pyplot as plt

from runner import train

forces = {"excitation.force.std": 20.0, "data.duration": 15.0}  # N on each floor, s
sensors = {"scenario": "noisy", "scenario.level": 0.05, "model/reads": "accelerations"}
laws = {"model.elements": "chain", "model.hinges": 0, "model.units": 1}
laws |= {"model.cubic": False, "model.rounded": False}
quick = {"baselines": "none", "figures": False, "data.calibration_records": 0}
run = train(model="element_network", system="shear_frame", **forces, **sensors, **laws, **quick)
errors = run.metrics["free_run"]
print(f"simulation of unseen motion: {errors['relative_rms_percent']:.1f} % against the sensors, "
      f"{errors['relative_rms_percent_true']:.1f} % against the true motion")  # fmt: skip

# %%
# Found and planted
# -----------------
# ``run.metrics`` has every parameter with the half width of its 95 % interval and, of a simulated
# structure, the truth. The interval is the wider of two: by the noise of the sensors, and by how
# far parts of the record disagree.
parameters = [p for p in run.metrics["uncertainty"]["parameters"] if "truth" in p]
parameters = [p for p in parameters if not p["name"].endswith("post_yield_ratio")]  # derived
# sphinx_gallery_thumbnail_number = 2
plt.rcParams.update({"font.size": 12, "axes.grid": True, "grid.alpha": 0.3})
figure, axes = plt.subplots(figsize=(6.4, 6.0), layout="constrained")
names, inside = [], 0
for row, p in enumerate(sorted(parameters, key=lambda p: p["name"].split(".")[::-1])):
    value, half, planted = p["value"], p["believed"], p["truth"]
    axes.errorbar(value / planted, row, xerr=half / planted, fmt="oC0", capsize=3)
    names.append(p["name"].replace("_", " ").replace(".", " "))
    inside += abs(value - planted) <= half
    print(f"{names[-1]:24} {value:9.4g} ± {half:<7.2g} {p['unit']:6} planted {planted:g}")
print(f"{inside} of {len(parameters)} intervals hold the planted value")
axes.axvline(1, color="k", lw=1)
axes.set_yticks(range(len(names)), names, fontsize=10)
axes.set(xlabel="found over planted [–]")
figure.suptitle("Intervals of 95 % about the planted values")
plt.show()

# %%
# The loops of the storeys
# ------------------------
# Neither displacements nor forces of storeys were measured. On a motion that the fit did not see,
# the model's loops lie on the true ones; shown are its last five seconds.
test = run.records["test"][0]
y, r = run.model.element_loops(test)  # m, N, (samples, storeys)
error = (r - test.truth.r).square().sum() / test.truth.r.square().sum()
print(f"error of the storeys' forces: {100 * error**0.5:.1f} % of their RMS")
how = {"sharex": True, "sharey": True, "layout": "constrained"}
figure, panels = plt.subplots(2, 2, figsize=(6.4, 5.6), **how)
for storey, axes in enumerate(panels.flat):
    true_y, true_r = 1000 * test.truth.y[-500:, storey], test.truth.r[-500:, storey]
    axes.plot(true_y, true_r, color="0.75", lw=3, label="true")
    axes.plot(1000 * y[-500:, storey], r[-500:, storey], "C3", lw=0.8, label="identified")
    axes.set(title=f"storey {storey + 1}", xlabel="drift [mm]", ylabel="force [N]")
    axes.label_outer()
panels[0, 0].legend(fontsize=10)
figure.suptitle("Loops that no sensor saw")
plt.show()

# %%
# **Beware.** The model's law contains that of the simulated frame. Of a real one it may not: then
# look at what the residual suggests, at other laws (``model.laws=named``, ``branch``), and at a
# second record. What an interval accounts for: :doc:`/uncertainty`. From files: :doc:`/identify`.
