"""Multilayer perceptrons on the state and the forces: of the whole system, or of its residual.

global:    ẍ̂[k] = N(x[k], ẋ[k], f[k])                                       9-10-10-3 for 3 DOFs
residual:  ẍ̂[k] = linear[k] − N(x[k], ẋ[k], f[k], ε[k−1]),  ε = linear − ẍ   12-15-3 for 3 DOFs
Brewick & Masri (2016), Sects. 2.3 and 3.3.3.   B records, T samples, n DOFs, m excitations.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import pad

from data.record import Drive, Record, Response
from models import mlp_compiled
from models.fit.trainable import Trainable
from models.layers.integrate import (
    differentiated,
    flat,
    run_compiled,
    runge_kutta,
    runge_kutta_delayed,
)
from models.layers.perceptron import ACTIVATIONS, Perceptron
from models.linear import EquivalentLinear
from models.mlp_compiled import Layers, Residual


class GlobalMLP(Trainable):
    """The acceleration as one network of displacements, velocities and excitation.

    hidden: neurons of each hidden layer; activation: tanh, sigmoid, relu or silu.
    """

    reads = ("x", "v", "f")

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        hidden: Sequence[int] = (10, 10),
        activation: str = "tanh",
    ) -> None:
        super().__init__(dofs, inputs, dt)
        self.network = Perceptron(2 * dofs + inputs, hidden, dofs, activation)

    def identify(self, batches: Iterable[Record]) -> dict[str, float]:
        """Fit the scaling; the weights are fitted by the solver."""
        self.network.input_scale.fit(r.counted(self.state(r)) for r in batches)
        self.network.output_scale.fit(r.counted(r.a) for r in batches)
        return {}

    def state(self, record: Record) -> Tensor:
        """[x, ẋ, f] (…, T, 2n + m)."""
        self.check(record)
        assert record.x is not None
        assert record.v is not None
        return torch.cat([record.x, record.v, record.excitation], dim=-1)

    def regression(self, record: Record) -> tuple[nn.Module, Tensor, Tensor]:
        return self.network, self.state(record), record.a

    def forward(self, record: Record) -> Tensor:
        return self.network(self.state(record))

    def acceleration(self, x: Tensor, v: Tensor, u: Tensor) -> Tensor:
        """ẍ (…, n) of a state and an excitation (…, m)."""
        return self.network(torch.cat([x, v, u], dim=-1))

    def free_run(self, drive: Drive) -> Response:
        if differentiated(drive.u, drive.x0, drive.v0, *self.parameters()):
            return runge_kutta(self.acceleration, drive)
        layers = layers_of(self.network)
        return run_compiled(mlp_compiled.run, layers, drive, self.identified_parameters)


class ResidualMLP(EquivalentLinear, Trainable):
    """Residual of the equivalent linear system (Eq. 8) as a network with its own delayed output.

    The residual ε = M⁻¹ f_NL [m/s²] is that of Eq. 9 as an acceleration, which needs no inverse of
    the identified mass matrix. `forward` feeds back the measured residual of the sample before;
    the estimate "own_residual" feeds back the network's own. Before the record it is zero.
    """

    reads = ("x", "v", "a", "f")

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        hidden: Sequence[int] = (15,),
        activation: str = "tanh",
        ridge: float = 0.0,
    ) -> None:
        super().__init__(dofs, inputs, dt, ridge)
        self.network = Perceptron(3 * dofs + inputs, hidden, dofs, activation)

    def identify(self, batches: Iterable[Record]) -> dict[str, float]:
        """Identify the linear system and the scaling; the network is fitted by the solver."""
        solution = super().identify(batches)
        self.network.input_scale.fit(r.counted(self.regressors(r)) for r in batches)
        self.network.output_scale.fit(r.counted(self.residual(r)) for r in batches)
        return solution

    def residual(self, record: Record) -> Tensor:
        """ε = linear − ẍ (…, T, n), from the measured acceleration."""
        return super().forward(record) - record.a

    def regressors(self, record: Record) -> Tensor:
        """[ẋ, x, f, ε delayed by a sample] (…, T, 3n + m)."""
        delayed = pad(self.residual(record), (0, 0, 1, 0))[..., :-1, :]
        return torch.cat([self.state(record), delayed], dim=-1)

    def regression(self, record: Record) -> tuple[nn.Module, Tensor, Tensor]:
        return self.network, self.regressors(record), self.residual(record)

    def forward(self, record: Record) -> Tensor:
        return super().forward(record) - self.network(self.regressors(record))

    def estimates(self, record: Record) -> dict[str, Tensor]:
        return {**super().estimates(record), "own_residual": self.with_own_residual(record)}

    def with_own_residual(self, record: Record) -> Tensor:
        """Estimate (…, T, n) that never sees a measured acceleration, without derivatives."""
        self.check(record)
        assert record.x is not None
        assert record.v is not None
        a = np.empty(flat(record.a).shape)
        signals = [flat(u) for u in (record.x, record.v, record.excitation)]
        mlp_compiled.own_estimates(self.parts(), *signals, a)
        return torch.from_numpy(a).view_as(record.a).to(record.a.device)

    def free_run(self, drive: Drive) -> Response:
        """The motion, with the network's own residual of the sample before."""
        self.require_identified(self.weights)
        if not differentiated(drive.u, drive.x0, drive.v0, *self.parameters()):
            run, parts = mlp_compiled.residual_run, self.parts()
            return run_compiled(run, parts, drive, self.identified_parameters)

        def law(x: Tensor, v: Tensor, u: Tensor, past: Tensor) -> tuple[Tensor, Tensor]:
            residual = self.network(torch.cat([v, x, u, past], dim=-1))
            return self.acceleration(x, v, u) - residual, residual

        return runge_kutta_delayed(law, drive, torch.zeros_like(drive.x0))

    def parts(self) -> Residual:
        """The numbers of the compiled law."""
        return Residual(self.weights.detach().cpu().numpy().copy(), layers_of(self.network))


def layers_of(model: Perceptron) -> Layers:
    """A perceptron for compiled code."""
    layers = [layer for layer in model.layers if isinstance(layer, nn.Linear)]
    sizes = [layers[0].in_features, *(layer.out_features for layer in layers)]
    kinds = {type(layer) for layer in model.layers} - {nn.Linear}
    scales = model.input_scale, model.output_scale
    inner, outer = (np.stack([s.centre.cpu().numpy(), s.reach.cpu().numpy()]) for s in scales)
    weights, biases = (
        np.concatenate([u.detach().cpu().numpy().T.ravel() for u in of_all])
        for of_all in ([layer.weight for layer in layers], [layer.bias for layer in layers])
    )
    activation = list(ACTIVATIONS.values()).index(kinds.pop())
    return Layers(weights, biases, np.array(sizes), inner, outer, max(sizes), activation)
