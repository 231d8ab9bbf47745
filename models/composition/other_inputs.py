"""Other inputs of an element, such as a voltage or a normal force: what they make of its laws.

r = Σ_j h_j(w) [law_j(s, ṡ, z_j) + Σ_m d_jm tanh(p_j/b_jm)] + r₀
τ_i ẇ_i = e_i − w_i,   τ_j ṗ_j = ṡ − p_j
Each input has nodes evenly over its range in training, and a law at each. Between two nodes h
interpolates their laws, beyond the last two it goes on. Several inputs share the force.
T samples, E elements, k inputs, J laws of an element, which stand law by law: index j E + e.
"""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor, nn
from torch.func import functional_call, jvp, vmap

from models.composition.coefficients import Coefficients
from models.layers.lag import lagged, reach_of
from models.layers.scaling import Extents

KNEES = (0.02, 0.5)  # of the largest rate: between these forces saturate at the start
LAG, RATE_LAG = 5.0, 2.0  # samples, at the start
TOGETHER = 8  # derivatives


class OtherInputs(nn.Module):
    """Forces (…, T, E) of the laws of E elements under k other inputs.

    nodes: laws of each input; rates: forces in each law that saturate with the rate.
    Raises ValueError for fewer than two nodes.
    """

    def __init__(self, elements: int, inputs: int, nodes: int, rates: int) -> None:
        super().__init__()
        if nodes < 2 or rates < 0:
            raise ValueError(f"model.nodes={nodes}, rates={rates}: expected at least 2 and 0")
        self.elements, self.nodes, self.laws = elements, nodes, inputs * nodes
        self.range = Extents(inputs)
        self.lag = Coefficients(inputs, positive=True)
        self.offset = Coefficients(elements)
        self.rate_force = Coefficients(self.laws * elements, rates)
        self.rate_knee = Coefficients(self.laws * elements, rates, positive=True)
        self.rate_lag = Coefficients(self.laws * elements, positive=True)

    @property
    def beyond(self) -> list[Coefficients]:
        """Those of forces beyond springs and dampers."""
        return [self.rate_force, self.rate_knee, self.rate_lag]

    @torch.no_grad()
    def start(self, inputs: Iterable[Tensor], force: Tensor, rate: Tensor, dt: float) -> None:
        """Start at springs and dampers; units by inputs (T, k), largest force and rate (E,)."""
        self.range.fit(inputs)
        self.lag.start(torch.full_like(self.lag.unit, LAG * dt))
        self.offset.start(force)
        self.rate_force.start(force.repeat(self.laws)[:, None].expand_as(self.rate_force.unit))
        count = self.rate_force.unit.shape[1]
        share = (torch.arange(count, dtype=torch.float64) + 0.5) / max(count, 1)
        knees = KNEES[0] * (KNEES[1] / KNEES[0]) ** share
        self.rate_knee.start(rate.repeat(self.laws)[:, None] * knees)
        self.rate_lag.start(torch.full_like(self.rate_lag.unit, RATE_LAG * dt))

    @torch.no_grad()
    def restart(self) -> None:
        """Go back to springs and dampers."""
        for coefficients in self.beyond:
            coefficients.theta.zero_()

    def weights(self, e: Tensor, dt: float, reach: int) -> Tensor:
        """h (…, T, J) of inputs e (…, T, k); their sum is one. reach: of the lags, in samples."""
        w = lagged(self.range(e), self.lag(), dt, reach)
        place = 0.5 * (w + 1.0) * (self.nodes - 1)  # node i is at i
        cell = place.detach().floor().clamp(0, self.nodes - 2)[..., None]
        share, nodes = place[..., None] - cell, torch.arange(self.nodes).to(cell)
        hats = (1.0 - share) * (nodes == cell) + share * (nodes == cell + 1)
        return hats.flatten(-2) / e.shape[-1]

    def reaches(self, dt: float) -> tuple[int, int]:
        """Samples for which inputs and rates are remembered."""
        return reach_of(self.lag(), dt), reach_of(self.rate_lag(), dt)

    def forward(self, forces: Tensor, u: Tensor, dt: float, reaches: tuple[int, int]) -> Tensor:
        """r (…, T, E) of forces of the laws (…, T, J·E) under the excitation [s, ṡ, e]."""
        E = self.elements
        h = self.weights(u[..., 2 * E :], dt, reaches[0])
        rates = torch.cat([u[..., E : 2 * E]] * self.laws, dim=-1)
        p = lagged(rates, self.rate_lag(), dt, reaches[1])[..., None]
        whole = forces + (self.rate_force() * torch.tanh(p / self.rate_knee())).sum(dim=-1)
        return (h[..., None] * whole.unflatten(-1, (self.laws, E))).sum(dim=-2) + self.offset()

    def weighed(self, slopes: Tensor, u: Tensor, dt: float) -> Tensor:
        """Slopes of r (…, T, E, P) by those of the laws' forces (…, T, J·E, P)."""
        h = self.weights(u[..., 2 * self.elements :], dt, self.reaches(dt)[0])
        return torch.einsum(
            "...tj,...tjep->...tep", h, slopes.unflatten(-2, (self.laws, self.elements))
        )

    def slopes(self, forces: Tensor, u: Tensor, dt: float) -> Tensor:
        """Slopes of r (…, T, E, Q) by the free parameters here, in their order."""
        theta = {n: p.detach() for n, p in self.named_parameters() if p.requires_grad}
        flat, reaches = torch.cat([p.reshape(-1) for p in theta.values()]), self.reaches(dt)

        def force(flat: Tensor) -> Tensor:
            parts = flat.split([p.numel() for p in theta.values()])
            named = {n: part.view(theta[n].shape) for n, part in zip(theta, parts, strict=True)}
            mixed: Tensor = functional_call(self, named, (forces, u, dt, reaches))
            return mixed

        unit = torch.eye(flat.numel()).to(flat)
        along = vmap(lambda t: jvp(force, (flat,), (t,))[1], chunk_size=TOGETHER)
        return along(unit).movedim(0, -1)
