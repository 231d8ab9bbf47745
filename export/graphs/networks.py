"""Free runs of recurrent networks, neural state spaces, MLPs and linear systems as graphs.

B runs, T samples, n DOFs, m excitations, H neurons.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch._higher_order_ops.scan import scan

from export.graphs.graph import Graph
from models.layers.perceptron import Perceptron
from models.linear import EquivalentLinear
from models.mlp import GlobalMLP
from models.neural_state_space import NeuralStateSpace
from models.recurrent import Recurrent

Motion = tuple[Tensor, Tensor, Tensor]


class RecurrentGraph(Graph):
    """That of models/recurrent.py."""

    def __init__(self, network: Recurrent, held: bool) -> None:
        super().__init__(held)
        self.lstm, self.layers = network.states == 2, network.cells.num_layers
        self.hidden, self.dofs = network.cells.hidden_size, network.dofs
        self.integrates = not bool(network.signals[1:].any())
        for k in range(self.layers):
            for kind in ("weight_ih", "weight_hh", "bias_ih", "bias_hh"):
                own: Tensor = getattr(network.cells, f"{kind}_l{k}")
                self.keep(**{f"{kind}{k}": own.T if own.ndim == 2 else own})
        self.keep(
            centre=network.input_scale.centre,
            reach=network.input_scale.reach,
            first_centre=network.state_scale.centre,
            first_reach=network.state_scale.reach,
            begin=network.begin.weight.T,
            begin_bias=network.begin.bias,
            head=network.head.weight.T,
            head_bias=network.head.bias,
            sizes=network.signals.flatten(),
            half_dt=torch.tensor(0.5 * network.dt, dtype=torch.float64),
            third=torch.tensor(network.dt**2 / 3.0, dtype=torch.float64),
            sixth=torch.tensor(network.dt**2 / 6.0, dtype=torch.float64),
            dt=torch.tensor(network.dt, dtype=torch.float64),
        )

    def forward(self, u: Tensor, x0: Tensor, v0: Tensor) -> Motion:
        u = (u - self.centre) / self.reach
        first = (torch.cat([x0, v0], dim=-1) - self.first_centre) / self.first_reach
        begin = (first @ self.begin + self.begin_bias).split(self.hidden, dim=-1)
        state = tuple(part.clone() for part in begin)  # h of all layers, then c of all layers
        _, hidden = scan(self.step, state, u.transpose(0, 1).contiguous(), dim=0)
        both = torch.cat([hidden.transpose(0, 1), u], dim=-1)
        motion = (both @ self.head + self.head_bias) * self.sizes
        a, x, v = motion.split(self.dofs, dim=-1)
        return self.integrated(a, x0, v0) if self.integrates else (x, v, a)

    def step(self, state: tuple[Tensor, ...], u: Tensor) -> tuple[tuple[Tensor, ...], Tensor]:
        h, c = list(state[: self.layers]), list(state[self.layers :])
        for k in range(self.layers):
            own = {kind: getattr(self, f"{kind}{k}") for kind in KINDS}
            by_u = u @ own["weight_ih"] + own["bias_ih"]
            by_h = h[k] @ own["weight_hh"] + own["bias_hh"]
            if self.lstm:
                i, f, g, o = (by_u + by_h).chunk(4, dim=-1)
                c[k] = torch.sigmoid(f) * c[k] + torch.sigmoid(i) * torch.tanh(g)
                h[k] = torch.sigmoid(o) * torch.tanh(c[k])
            else:
                (reset, update, new), (r, z, n) = by_u.chunk(3, dim=-1), by_h.chunk(3, dim=-1)
                keep = torch.sigmoid(update + z)
                fresh = torch.tanh(new + torch.sigmoid(reset + r) * n)
                h[k] = fresh + keep * (h[k] - fresh)
            u = h[k]
        return (*h, *c), u.clone()

    def integrated(self, a: Tensor, x0: Tensor, v0: Tensor) -> Motion:
        """As models/layers/integrate.py has it."""
        first, last = a[:, :-1], a[:, 1:]
        v = torch.cat([v0[:, None], self.half_dt * (first + last)], dim=1).cumsum(dim=1)
        moved = self.dt * v[:, :-1] + self.third * first + self.sixth * last
        return torch.cat([x0[:, None], moved], dim=1).cumsum(dim=1), v, a


KINDS = ("weight_ih", "weight_hh", "bias_ih", "bias_hh")


class StateSpaceGraph(Graph):
    """That of models/neural_state_space.py."""

    def __init__(self, network: NeuralStateSpace, held: bool) -> None:
        super().__init__(held)
        n, m = network.dofs, network.inputs
        of_state, of_u, of_a = network.sizes.split([2 * n, m, n])
        encoder = network.encoder.weight.T[-(2 * n + m) :]  # the time before is rest
        self.keep(of_state=of_state, of_u=of_u, of_a=of_a, encoder=encoder)
        for name, layer in (("step", network.step), ("out", network.output)):
            linear, inner, bias, outer, shift = layer.theta()
            self.keep(**{f"{name}_linear": linear.T, f"{name}_inner": inner.T})
            self.keep(**{f"{name}_bias": bias, f"{name}_outer": outer.T, f"{name}_shift": shift})

    def forward(self, u: Tensor, x0: Tensor, v0: Tensor) -> Motion:
        first, u = torch.cat([x0, v0], dim=-1) / self.of_state, u / self.of_u
        z = torch.cat([first, torch.cat([first, u[:, 0]], dim=-1) @ self.encoder], dim=-1)
        states = torch.cat([z[:, None], self.through_time(self.step, (z,), u)], dim=1)
        a = self.layer("out", torch.cat([states, u], dim=-1)) * self.of_a
        x, v = (states[..., : self.of_state.shape[0]] * self.of_state).chunk(2, dim=-1)
        return x, v, a

    def step(
        self, state: tuple[Tensor, ...], ends: tuple[Tensor, ...]
    ) -> tuple[tuple[Tensor, ...], Tensor]:
        first, last = ends
        z = self.layer("step", torch.cat([state[0], first, first if self.held else last], dim=-1))
        return (z,), z.clone()

    def layer(self, name: str, both: Tensor) -> Tensor:
        linear, inner, bias, outer, shift = (
            getattr(self, f"{name}_{part}")
            for part in ("linear", "inner", "bias", "outer", "shift")
        )
        return both @ linear + torch.tanh(both @ inner + bias) @ outer + shift


class AccelerationGraph(Graph):
    """That of ẍ = g(x, ẋ, u) by the method of Runge and Kutta, as models/layers/integrate.py."""

    def __init__(self, dt: float, held: bool) -> None:
        super().__init__(held)
        one = torch.ones((), dtype=torch.float64)
        self.keep(
            dt=dt * one, half_dt=0.5 * dt * one, sixth=dt / 6.0 * one, sixths=dt**2 / 6.0 * one
        )

    def acceleration(self, x: Tensor, v: Tensor, u: Tensor) -> Tensor:
        """ẍ (B, n)."""
        raise NotImplementedError

    def forward(self, u: Tensor, x0: Tensor, v0: Tensor) -> Motion:
        a = self.acceleration(x0, v0, u[:, 0])
        out = self.through_time(self.step, (x0.clone(), v0.clone(), a), u)
        begin = torch.cat([x0, v0, a], dim=-1)[:, None]
        x, v, a = torch.cat([begin, out], dim=1).chunk(3, dim=-1)
        return x, v, a

    def step(
        self, state: tuple[Tensor, ...], ends: tuple[Tensor, ...]
    ) -> tuple[tuple[Tensor, ...], Tensor]:
        (x, v, a), (first, now) = state, ends
        end = first if self.held else now
        middle = first if self.held else 0.5 * (first + now)
        v2 = v + self.half_dt * a
        a2 = self.acceleration(x + self.half_dt * v, v2, middle)
        v3 = v + self.half_dt * a2
        a3 = self.acceleration(x + self.half_dt * v2, v3, middle)
        a4 = self.acceleration(x + self.dt * v3, v + self.dt * a3, end)
        x = x + self.dt * v + self.sixths * (a + a2 + a3)
        v = v + self.sixth * (a + a4 + 2.0 * (a2 + a3))
        a = self.acceleration(x, v, now)
        return (x, v, a), torch.cat([x, v, a], dim=-1)


class MLPGraph(AccelerationGraph):
    """That of a global MLP."""

    def __init__(self, estimator: GlobalMLP, held: bool) -> None:
        super().__init__(estimator.dt, held)
        self.keep_network(estimator.network)

    def keep_network(self, network: Perceptron) -> None:
        layers = [layer for layer in network.layers if isinstance(layer, torch.nn.Linear)]
        self.depth, self.bend = len(layers), network.layers[1]
        for k, layer in enumerate(layers):
            self.keep(**{f"weight{k}": layer.weight.T, f"bias{k}": layer.bias})
        scales = {"input": network.input_scale, "output": network.output_scale}
        for name, scale in scales.items():
            self.keep(**{f"{name}_centre": scale.centre, f"{name}_reach": scale.reach})

    def acceleration(self, x: Tensor, v: Tensor, u: Tensor) -> Tensor:
        signal = (torch.cat([x, v, u], dim=-1) - self.input_centre) / self.input_reach
        for k in range(self.depth):
            signal = signal @ getattr(self, f"weight{k}") + getattr(self, f"bias{k}")
            signal = self.bend(signal) if k + 1 < self.depth else signal
        return self.output_centre + self.output_reach * signal


class LinearGraph(Graph):
    """That of an equivalent linear system, exact between samples."""

    def __init__(self, linear: EquivalentLinear, held: bool) -> None:
        super().__init__(held)
        step, first, last = linear._exact_step("zero_order" if held else "linear")
        self.keep(transition=step, of_first=first, of_last=last, weights=linear.weights)

    def forward(self, u: Tensor, x0: Tensor, v0: Tensor) -> Motion:
        begin = torch.cat([x0, v0], dim=-1)
        out = self.through_time(self.step, (begin,), u)
        x, v = torch.cat([begin[:, None], out], dim=1).chunk(2, dim=-1)
        return x, v, torch.cat([v, x, u], dim=-1) @ self.weights

    def step(
        self, state: tuple[Tensor, ...], ends: tuple[Tensor, ...]
    ) -> tuple[tuple[Tensor, ...], Tensor]:
        now = state[0] @ self.transition + ends[0] @ self.of_first + ends[1] @ self.of_last
        return (now,), now.clone()
