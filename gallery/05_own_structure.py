"""
Your own structure in twelve lines
==================================

A structure is a list of masses and of elements between them. This page builds a two-storey frame
whose first storey yields, shakes it by random forces, and looks at drifts, loops and energy. All
you need is a sketch with masses and springs.
"""

# %%
# The structure
# -------------
# ``x1`` and ``x2`` are masses, ``ground`` stands still. The deformation of an element is the
# position of its second node minus that of its first. All units are SI: kg, N, m, s.
import matplotlib.pyplot as plt
import torch

from data import (
    BandLimitedGaussian,
    Bilinear,
    Excitation,
    FullState,
    Polynomial,
    Simulation,
    Structure,
)

yielding = {"yield_displacement": 0.01, "stiffness": 800.0, "post_yield_stiffness": 200.0}
frame = Structure(
    masses=[2.0, 1.5],
    elements={
        "first storey": Bilinear(between=["ground", "x1"], **yielding, damping=1.0),
        "second storey": Polynomial(between=["x1", "x2"], stiffness=600.0, damping=0.5),
        "brace": Polynomial(between=["ground", "x2"], stiffness=50.0, cubic_stiffness=1e4),
    },
)
print("natural frequencies:", *(f"{f:.2f} Hz" for f in frame.natural_frequencies()))

# %%
# Its motion
# ----------
# A random force acts on each mass. The same ``seed`` gives the same motion again. ``records`` also
# returns motions that escaped, which only softening structures have.
forces = Excitation(force=BandLimitedGaussian(std=5.0, band=(0.1, 5.0)))  # N, Hz
simulation = Simulation(frame, forces, FullState(), dt=0.01, duration=30.0)  # s
(record,), _ = simulation.records("train", count=1, seed=0)
truth = record.truth  # of the elements: deformation y [m] and force r [N], which no sensor sees

# sphinx_gallery_thumbnail_number = 2
plt.rcParams.update({"font.size": 12, "axes.grid": True, "grid.alpha": 0.3})
t = record.dt * torch.arange(record.samples)
figure, axes = plt.subplots(figsize=(6.4, 4.2), layout="constrained")
axes.plot(t, 1000 * truth.y[:, 0], lw=1, label="first storey")
axes.plot(t, 1000 * truth.y[:, 1], lw=1, label="second storey")
axes.axhspan(-10, 10, color="0.85", label="the first storey yields beyond 10 mm")
axes.set(xlabel="time [s]", ylabel="drift [mm]", title="The yielding storey drifts most")
figure.legend(loc="outside lower center", ncols=2, fontsize=11, frameon=False)
plt.show()

# %%
# Forces against deformations
# ---------------------------
# The force of the first storey depends on its past: its loops enclose the energy that it
# dissipates. The second storey is a straight line, widened by its damper. The brace stiffens.
figure, panels = plt.subplots(1, len(frame.elements), figsize=(7.2, 3.2), layout="constrained")
for i, (name, axes) in enumerate(zip(frame.elements, panels, strict=True)):
    axes.plot(1000 * truth.y[:, i], truth.r[:, i], lw=0.8)
    axes.set(xlabel="deformation [mm]", ylabel="force [N]", title=name)
figure.suptitle("Only the first storey has loops: it yields")
plt.show()

# %%
# Where does the energy go?
# -------------------------
# The work of the forces is the kinetic energy plus the work that the elements take up: a check that
# every simulation should pass. Rates of deformation follow from the velocities of the nodes. What
# is left between the two lines comes from the trapezoidal rule of this page.
rate = torch.stack([truth.v[:, 0], truth.v[:, 1] - truth.v[:, 0], truth.v[:, 1]], dim=-1)
work = torch.cumulative_trapezoid(truth.r * rate, dx=record.dt, dim=0)  # J, of each element
work_in = torch.cumulative_trapezoid((record.f * truth.v).sum(-1), dx=record.dt)
kinetic = 0.5 * (torch.tensor(frame.masses) * truth.v[1:] ** 2).sum(-1)

figure, axes = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
axes.plot(t[1:], work_in, color="0.75", lw=5, label="work of the forces")
axes.plot(t[1:], work.sum(-1) + kinetic, "k", lw=1, label="kinetic energy + work of all elements")
axes.plot(t[1:], work[:, 0], "C3", label="work of the first storey")
axes.set(xlabel="time [s]", ylabel="energy [J]", title="The first storey takes up most of it")
axes.legend(fontsize=10)
gap = (work_in - work.sum(-1) - kinetic).abs().max() / work_in.max()
print(f"the balance is off by {gap:.1%} at most")
print(f"the first storey took up {work[-1, 0] / work_in[-1]:.0%} of the work")
plt.show()

# %%
# **Beware.** Masses move along one line each, and elements have no mass. A wall that bends needs
# elements between floors that are not neighbours. More laws, and the same structure as a file for
# the command line: :doc:`/adding`.
