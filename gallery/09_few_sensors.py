"""
Few sensors: the drift of storeys that have none
================================================

A three-storey steel frame has accelerometers on the ground and on the roof. After an earthquake the
owner asks how far each storey drifted. This page identifies the frame from two earlier shakings and
answers for a stronger one, with intervals.
"""

# %%
# Two records of ground and roof
# ------------------------------
# The building is simulated here, so that the truth is known. Its storeys are of steel (Menegotto
# and Pinto); the ground moves like an earthquake; the roof's sensor has 3 % of noise. The force
# channel of a shaken base is minus the acceleration of the ground.
import matplotlib.pyplot as plt
import numpy as np
import torch

from data import MenegottoPinto, Record, Structure
from data.simulation.motion import simulate
from models import ElementNetwork
from models.uncertainty.drifts import storeys_of

dt, masses, rng = 0.02, [2.0e5, 2.0e5, 1.8e5], np.random.default_rng(0)  # s, kg
nodes, storeys = ["ground", "x1", "x2", "x3"], {}
for i, (stiffness, drift) in enumerate([(1.2e8, 0.015), (1.0e8, 0.012), (0.8e8, 0.012)]):
    own = {"stiffness": stiffness, "yield_displacement": drift, "damping": 4e5}  # N/m, m, N s/m
    storeys[f"r{i + 1}"] = MenegottoPinto(between=nodes[i : i + 2], hardening_ratio=0.05, **own)
building, t = Structure(masses, storeys), dt * np.arange(1000)


def shake(size):
    """A record of the roof under a ground motion of its own, and the whole motion."""
    w, phase = 2 * np.pi * rng.uniform(0.3, 5.0, 12), rng.uniform(0, 2 * np.pi, 12)
    ground = size * (t / 4 * np.exp(1 - t / 4)) ** 1.5 * np.sin(np.outer(t, w) + phase).sum(axis=1)
    motion = simulate(building, -np.outer(ground, masses), dt)
    roof = torch.from_numpy(motion.a[:, 2:])  # relative to the ground
    roof = roof + 0.03 * roof.std() * torch.from_numpy(rng.standard_normal(roof.shape))
    return Record(dt, roof, torch.from_numpy(-ground[:, None]), numbers=(3,)), motion


(first, _), (second, _), (later, true) = shake(0.4), shake(0.5), shake(0.8)

# %%
# A model of all storeys
# ----------------------
# Masses are known from drawings; two kinds of steel are offered. ``sensors=[3]`` says that the only
# channel is the roof's.
model = ElementNetwork(
    3, 1, dt, elements="chain", masses=masses, forced="base", sensors=[3],
    laws=["Bilinear", "MenegottoPinto"],
)  # fmt: skip
facts = model.identify([first, second])
print("law:", facts["laws"], "| not determined:", facts["sensors_do_not_determine"] or "nothing")
for p in model.physical_parameters():
    if p.name.endswith((".stiffness", ".yield_displacement")):
        e, name = p.name.split(".")
        print(f"{p.name:22} {p.value:9.4g} {p.unit:4} planted {getattr(storeys[e], name):g}")

# %%
# The stronger motion
# -------------------
# ``storeys_of`` runs the model, and 32 others that the two records leave as likely. Compared is a
# straight line from ground to roof, for which we even take the true displacement of the roof.
rows = storeys_of(model, later.drive())
peak, half = (1000 * np.array([row[key] for row in rows]) for key in ("peak", "peak_half"))
truth, line = 1000 * abs(true.y).max(axis=0), 1000 * abs(true.x[:, 2]).max() / 3
for e in range(3):
    print(f"storey {e + 1}: peak {peak[e]:.1f} ± {half[e]:.1f} mm, true {truth[e]:.1f} mm")

plt.rcParams.update({"font.size": 12, "axes.grid": True, "grid.alpha": 0.3})
figure, axes = plt.subplots(figsize=(6.4, 4.2), layout="constrained")
axes.barh([1, 2, 3], truth, color="0.8", label="true")
axes.errorbar(peak, [1, 2, 3], xerr=half, fmt="oC0", capsize=4, label="model, 95 % interval")
axes.axvline(line, color="C3", ls="--", label="straight line to the roof")
axes.set(xlabel="peak drift [mm]", ylabel="storey [–]", yticks=[1, 2, 3])
axes.set_title("Where it yields shows only with a model")
figure.legend(loc="outside lower center", ncols=2, fontsize=11, frameon=False)

figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
y = model.trace(later.drive()).deformations
axes.plot(t, 1000 * true.y[:, 0], color="0.75", lw=4, label="true")
axes.plot(t, 1000 * y[:, 0], "C0", lw=1, label="model of ground and roof")
axes.plot(t, 1000 * true.x[:, 2] / 3, "C3--", lw=1, label="straight line to the roof")
axes.set(xlabel="time [s]", ylabel="drift of storey 1 [mm]")
axes.set_title("A storey without a sensor, second by second")
figure.legend(loc="outside lower center", ncols=2, fontsize=11, frameon=False)
plt.show()

# %%
# **Beware.** The planted law was among those offered, masses were exact, and the building was a
# shear chain. How wrong masses, other laws and fewer records show: :doc:`/few_sensors`; the
# intervals there hold fewer true values than they promise.
