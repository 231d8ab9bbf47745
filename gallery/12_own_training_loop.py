"""
Training in your own PyTorch loop
=================================

Every model of the zoo is an ``nn.Module``, signals are tensors, and windows of records are a
``Dataset``. Your own loop trains them. This one first reduces the error one step ahead, then the
error of a simulation, with gradients that flow back through the time integration.
"""

# %%
# Data
# ----
# A mass on a spring that hardens. Thirty tests of two seconds begin at rest; displacement, velocity
# and acceleration have 20 % of noise. ``stack`` joins records to a batch, in which signals are
# (records, samples, channels). ``WindowDataset(train, length=50)`` would cut windows.
from copy import deepcopy

import matplotlib.pyplot as plt
import torch
from torch.utils.data import DataLoader

from data import (
    BandLimitedGaussian,
    Excitation,
    Noisy,
    Polynomial,
    Simulation,
    Structure,
    WindowDataset,
)
from data.record import stack
from models import GlobalMLP

spring = Polynomial(between=["ground", "x1"], stiffness=40.0, cubic_stiffness=8e3, damping=1.0)
mass = Structure(masses=[1.0], elements={"spring": spring})  # kg, N/m, N/m³, N s/m
forces = Excitation(force=BandLimitedGaussian(std=2.0, band=(0.0, 3.0)))  # N, Hz
tests = Simulation(mass, forces, Noisy(level=0.2), dt=0.01, duration=2.0)  # s
train, _ = tests.records("train", count=30, seed=0)
loader = DataLoader(WindowDataset(train), batch_size=len(train), collate_fn=stack)
unseen = Simulation(mass, forces, Noisy(level=0.2), dt=0.01, duration=20.0)
(test,), _ = unseen.records("test", count=1, seed=0)
print("one batch has accelerations of shape", tuple(next(iter(loader)).a.shape))

# %%
# Two ways to estimate
# --------------------
# One step ahead, the model sees the measured state at every sample. In a free run it sees the force
# and the first state, here rest; all later states are its own.
ways = {
    "one step ahead": lambda model, record: model(record),
    "in free run": lambda model, record: model.free_run(record.drive()).a,
}


def relative(estimate, a):
    return ((estimate - a).square().sum() / a.square().sum()).sqrt()


# %%
# The loop
# --------
# ``identify`` solves what has a closed form: here the scaling of inputs and outputs. Any optimizer
# of PyTorch works; for small networks on whole batches L-BFGS takes far fewer steps than Adam. It
# asks for the loss several times a step, hence the closure.
torch.manual_seed(0)
model = GlobalMLP(dofs=1, inputs=1, dt=0.01, hidden=[10])  # x, v and f to the acceleration
model.identify(train)
trained = {}
for way, epochs in (("one step ahead", 30), ("in free run", 3)):
    optimizer = torch.optim.LBFGS(model.parameters(), max_iter=10, line_search_fn="strong_wolfe")
    for batch in [*loader] * epochs:

        def closure(batch=batch, way=way, optimizer=optimizer):
            optimizer.zero_grad()
            loss = relative(ways[way](model, batch), batch.a) ** 2
            loss.backward()
            return loss

        optimizer.step(closure)
    trained[way] = deepcopy(model).requires_grad_(False)

# %%
# What it brought
# ---------------
# Compared with ``truth``, the motion without noise, which only a simulation knows. Training on the
# free run makes the error one step ahead larger, and the simulation better.
for way, net in trained.items():
    errors = [f"{100 * relative(of(net, test), test.truth.a):.1f} % {w}" for w, of in ways.items()]
    print(f"trained {way}: errs by", " and ".join(errors))

plt.rcParams.update({"font.size": 12, "axes.grid": True, "grid.alpha": 0.3})
t, colours = test.dt * torch.arange(test.samples), {"one step ahead": "C1", "in free run": "C0"}
figure, axes = plt.subplots(figsize=(6.4, 4), layout="constrained")
axes.plot(t, 1000 * test.truth.x, color="0.75", lw=5, label="true motion")
for way, net in trained.items():
    x = net.free_run(test.drive()).x
    axes.plot(t, 1000 * x, color=colours[way], label=f"trained {way}")
axes.set(xlabel="time [s]", ylabel="displacement [mm]", xlim=(10, 16))
axes.set_title("Unseen motion, simulated from its force alone")
figure.legend(loc="outside lower center", ncols=2, fontsize=11, frameon=False)
plt.show()

# %%
# Why: noise in the *inputs* of a regression flattens what it finds (errors in variables). In a free
# run the model's own displacement is its input, and has no noise.
x = torch.linspace(-0.12, 0.12, 101)[:, None].double()
figure, axes = plt.subplots(figsize=(6.4, 3.8), layout="constrained")
axes.plot(1000 * x, 40.0 * x + 8e3 * x**3, color="0.75", lw=5, label="true spring")
for way, net in trained.items():
    force = -net.acceleration(x, 0 * x, 0 * x)  # of 1 kg, without velocity and excitation
    axes.plot(1000 * x, force, color=colours[way], label=f"trained {way}")
axes.set(xlabel="displacement [mm]", ylabel="spring force [N]")
axes.set_title("Trained in free run, it comes closer to the spring")
axes.legend(fontsize=10)
plt.show()

# %%
# **Beware.** A free run over long records may diverge early in training, and its gradient with it:
# begin with short ones, as here, or from weights that were trained one step ahead. The solvers of
# the zoo do both, and need no loop: ``python train.py model=global_mlp objective=free_run``. More:
# :doc:`/estimator`.
