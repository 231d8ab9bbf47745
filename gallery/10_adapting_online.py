"""
On line: adapting while it shakes
=================================

A model that learns sample by sample follows a structure that changes. A four-storey frame loses a
fifth of the stiffness of its second storey in the middle of a motion; this page watches the
identified stiffness fall, and shows what the memory of the model has to do with it.
"""

# %%
# A model with a memory
# ---------------------
# ``online_linear`` estimates accelerations as a linear function of velocities, displacements and
# forces. After every sample, recursive least squares adapts its weights. With a forgetting factor λ
# it remembers about 1/(1 − λ) samples, so 1 forgets nothing. It learns in one pass over 50 s of the
# sound frame; the damage comes at 25 s of the test motion. Displacements,
# velocities and accelerations have 2 % of noise.
import time

import matplotlib.pyplot as plt
import torch

from data.sample import samples_of
from runner import train

settings = {
    "system": "shear_frame",
    "scenario": "noisy",
    "scenario.level": 0.02,
    "damage": "sudden",
}
settings |= {"excitation.force.std": 3.0}  # N, so that the frame hardly yields
settings |= {"baselines": "none", "figures": False, "data.calibration_records": 0}
runs = {
    factor: train(model="online_linear", **settings, **{"adaptation.forgetting": factor})
    for factor in (0.99, 0.998, 1.0)
}
test = runs[1.0].records["test"][0]

# %%
# Sample by sample
# ----------------
# ``step`` returns the estimate of a sample, made before its acceleration is known, and then adapts.
# The weight of x1 in the estimate of a1 is minus the stiffness at the first floor over its mass,
# (k1 + k2)/m1 where nothing yields. Noise of the measured displacements makes it a bit too small.
x1, a1 = test.dofs, 0  # row of the weight (velocities come first) and its column
stiffness, errors = {}, {}
for factor, run in runs.items():
    stream, found, estimates = run.model.stream(), [], []
    begin = time.perf_counter()
    for sample in samples_of(test):
        estimates.append(stream.step(sample))
        found.append(-float(stream.weights[0][x1, a1]))
    spent = 1e6 * (time.perf_counter() - begin) / test.samples
    stiffness[factor], errors[factor] = found, torch.stack(estimates) - test.a
    print(f"λ = {factor:5}: {spent:.0f} µs a sample")

plt.rcParams.update({"font.size": 12, "axes.grid": True, "grid.alpha": 0.3})
t = test.dt * torch.arange(test.samples)
labels = {0.99: "1 s (λ = 0.99)", 0.998: "5 s (λ = 0.998)", 1.0: "everything (λ = 1)"}
figure, axes = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
true = torch.where(t < 25, 2 * 20e3 / 20, (20e3 + 0.8 * 20e3) / 20)  # N/m and kg of the frame
axes.plot(t, true, color="0.75", lw=5, label="true, for small motions")
for (factor, found), colour in zip(stiffness.items(), ("C1", "C0", "C2"), strict=True):
    axes.plot(t, found, color=colour, lw=1, label=f"remembers {labels[factor]}")
axes.set(xlabel="time [s]", ylabel="stiffness over mass [1/s²]", ylim=(1600, 2100))
axes.set_title("A short memory follows, and trembles")
figure.legend(loc="outside lower center", ncols=2, fontsize=11, frameon=False)
plt.show()

# %%
# The error one step ahead
# ------------------------
# Its RMS over the last two seconds rises where the model still remembers the sound frame.
figure, axes = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
window = torch.ones(1, 1, 200).double() / 200
for (factor, error), colour in zip(errors.items(), ("C1", "C0", "C2"), strict=True):
    mean = torch.nn.functional.conv1d(error[:, 0].square()[None, None], window)[0, 0]
    axes.plot(t[199:], mean.sqrt(), color=colour, lw=1, label=f"remembers {labels[factor]}")
    before, after = (error[s].square().mean().sqrt() for s in (slice(0, 2500), slice(3000, None)))
    print(f"λ = {factor:5}: RMS error before {before:.3f} m/s², from 30 s on {after:.3f} m/s²")
axes.axvline(25, color="k", ls=":", label="a fifth of k2 is lost")
axes.set(xlabel="time [s]", ylabel="RMS error of a1 [m/s²]", ylim=0)
axes.set_title("What does not forget keeps a wrong stiffness")
figure.legend(loc="outside lower center", ncols=2, fontsize=11, frameon=False)
plt.show()

# %%
# **Beware.** An equivalent stiffness also falls when the structure yields or when the sensors get
# noisier: a fall alone is no proof of damage. A detector with a known rate of false alarms is in
# :doc:`/detection`; the laws of adaptation and their cost are in :doc:`/online`.
