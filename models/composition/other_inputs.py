"""Other inputs of an element, such as a voltage or a normal force: what they make of its laws.

r = Σ_j h_j(w) [law_j(s, ṡ, z_j) + Σ_m d_jm tanh(p_j/b_jm)] + r₀
τ_i ẇ_i = e_i − w_i,   τ_j ṗ_j = ṡ − p_j
Each input has nodes in its range in training, where its values are, and a law at each. Between two
nodes h interpolates their laws, beyond the last two it goes on. Several inputs share the force.
T samples, E elements, k inputs, J laws of an element, which stand law by law: index j E + e.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.func import jvp
from torch.nn.functional import pad

from data.record import Drive, Response
from models.composition.coefficients import Coefficients
from models.composition.trace import Trace
from models.layers.scaling import Extents

KNEES = (0.02, 0.5)  # of the largest rate: between these forces saturate at the start
LAG, RATE_LAG = 5.0, 2.0  # samples, at the start
FEWEST = 0.01  # of the samples at a node
BEYOND = 10.0  # half ranges: the place of nodes that no data are near


class OtherInputs(nn.Module):
    """Forces (…, T, E) of the laws of E elements under k other inputs.

    nodes: laws of each input; rates: forces in each law that saturate with the rate.
    """

    places: Tensor  # (k, nodes), of the range
    used: Tensor  # (k,): nodes with data, the first of them all

    def __init__(self, elements: int, inputs: int, nodes: int, rates: int) -> None:
        super().__init__()
        self.elements, self.nodes, self.laws = elements, nodes, inputs * nodes
        self.range = Extents(inputs)
        even = torch.linspace(-1.0, 1.0, nodes, dtype=torch.float64).repeat(inputs, 1)
        self.register_buffer("places", even)
        self.register_buffer("used", torch.full((inputs,), nodes))
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
    def start(self, e: Tensor, force: Tensor, rate: Tensor, dt: float) -> None:
        """Start at springs and dampers; units by inputs e (T, k), largest force and rate (E,)."""
        self.range.fit([e])
        scaled = self.range(e.to(self.places.device)).cpu()
        for i, values in enumerate(scaled.unbind(dim=-1)):
            found = nodes_among(values, self.nodes)
            self.used[i] = len(found)
            self.places[i, : len(found)] = found
            self.places[i, len(found) :] = BEYOND + torch.arange(self.nodes - len(found))
        self.lag.start(torch.full_like(self.lag.unit, LAG * dt))
        self.offset.start(force)
        self.rate_force.start(force.repeat(self.laws)[:, None].expand_as(self.rate_force.unit))
        count = self.rate_force.unit.shape[1]
        share = (torch.arange(count, dtype=torch.float64) + 0.5) / max(count, 1)
        knees = KNEES[0] * (KNEES[1] / KNEES[0]) ** share
        rate = torch.where(rate > 0.0, rate, 1.0)  # a test without rates
        self.rate_knee.start(rate.repeat(self.laws)[:, None] * knees)
        self.rate_lag.start(torch.full_like(self.rate_lag.unit, RATE_LAG * dt))

    @torch.no_grad()
    def restart(self) -> None:
        """Go back to springs and dampers."""
        for coefficients in self.beyond:
            coefficients.theta.zero_()

    def weights(self, w: Tensor) -> tuple[Tensor, Tensor]:
        """h (…, T, J) of lagged inputs w (…, T, k), whose sum is one, and the slopes of h by w."""
        passed = (w[..., None] >= self.places[:, 1:]).sum(dim=-1)
        cell = torch.minimum(passed, self.used - 2)[..., None]  # the last one goes on
        nodes = torch.arange(self.nodes).to(cell)
        left, right = (nodes == cell).double(), (nodes == cell + 1).double()
        start, end = ((self.places * at).sum(dim=-1) for at in (left, right))
        share = ((w - start) / (end - start))[..., None]
        by_w = (right - left) / (end - start)[..., None]
        inputs = w.shape[-1]
        h = ((1.0 - share) * left + share * right).flatten(-2) / inputs
        return h, by_w.flatten(-2) / inputs

    def forward(self, forces: Tensor, u: Tensor, dt: float) -> Tensor:
        """r (…, T, E) of forces of the laws (…, T, J·E) under the excitation [s, ṡ, e]."""
        h, _ = self.weights(lagged(self._inputs(u), self.lag(), dt))
        p = lagged(self._rates(u), self.rate_lag(), dt)[..., None]
        whole = forces + (self.rate_force() * torch.tanh(p / self.rate_knee())).sum(dim=-1)
        return (h[..., None] * self._by_law(whole)).sum(dim=-2) + self.offset()

    def response(self, forces: Tensor, drive: Drive) -> Response:
        """Forces (…, T, E) by those of the laws (…, T, J·E); x and v are the imposed motion."""
        E, u = self.elements, drive.u
        return Response(u[..., :E], u[..., E : 2 * E], self(forces, u, drive.dt))

    @torch.no_grad()
    def weighed(self, run: Trace, drive: Drive) -> Trace:
        """The run of the elements by that of their laws; the parameters here are the first."""
        u, forces = drive.u, run.response.a
        h, _ = self.weights(lagged(self._inputs(u), self.lag(), drive.dt))
        laws = (self.laws, self.elements)
        jacobian, by_begin = (
            torch.einsum("...tj,...tjep->...tep", h, slopes.unflatten(-2, laws))
            for slopes in (run.jacobian, run.by_begin)
        )
        if jacobian.shape[-1]:
            slopes = self.slopes(forces, u, drive.dt)
            jacobian[..., : slopes.shape[-1]] = slopes
        motion = self.response(forces, drive)
        return Trace(motion, motion.a, motion.x, jacobian, by_begin)

    def slopes(self, forces: Tensor, u: Tensor, dt: float) -> Tensor:
        """Slopes of r (…, T, E, ·) by the free parameters here, in their order."""
        w, w_by_lag = with_slope(self._inputs(u), self.lag(), self.lag.slope(), dt)
        p, p_by_lag = with_slope(self._rates(u), self.rate_lag(), self.rate_lag.slope(), dt)
        h, h_by_w = self.weights(w)
        force, knee = self.rate_force(), self.rate_knee()
        x = p[..., None] / knee
        step = torch.tanh(x)
        steep, each = force * (1.0 - step**2), h.repeat_interleave(self.elements, dim=-1)
        whole = self._by_law(forces + (force * step).sum(dim=-1))
        by_w = (h_by_w[..., None] * whole).unflatten(-2, (-1, self.nodes)).sum(dim=-2)
        slopes = {
            self.lag: (w_by_lag[..., None] * by_w).mT,
            self.offset: torch.diag(self.offset.unit).expand(*h.shape[:-1], -1, -1),
            self.rate_force: self._own(each[..., None] * self.rate_force.unit * step),
            self.rate_knee: self._own(-each[..., None] * steep * x),
            self.rate_lag: self._own((each * p_by_lag * (steep / knee).sum(dim=-1))[..., None]),
        }
        free = [slope for c, slope in slopes.items() if c.theta.requires_grad]
        return torch.cat(free, dim=-1)

    def _inputs(self, u: Tensor) -> Tensor:
        return self.range(u[..., 2 * self.elements :])

    def _rates(self, u: Tensor) -> Tensor:
        return torch.cat([u[..., self.elements : 2 * self.elements]] * self.laws, dim=-1)

    def _by_law(self, forces: Tensor) -> Tensor:
        return forces.unflatten(-1, (self.laws, self.elements))

    def _own(self, slopes: Tensor) -> Tensor:
        """Slopes (…, T, E, J·E·M) of forces by numbers (J·E, M) of which each acts on its own."""
        of_law = slopes.unflatten(-2, (self.laws, self.elements))
        own = torch.eye(self.elements).to(slopes)[:, None, :, None]
        return (own * of_law[..., None, :, :, :]).flatten(-3)


def nodes_among(values: Tensor, most: int) -> Tensor:
    """Places in [−1, 1], both ends and up to `most` − 2 between: evenly if the values (T,) allow.

    A law at a place without data would be nobody's. Where one has none, as of an input of a few
    levels, each place goes to the mean of the values that are nearest to it (Lloyd 1982).
    """
    places = torch.linspace(-1.0, 1.0, most, dtype=torch.float64)
    for _ in range(20):  # as a rule all have arrived long before
        nearest = (values[:, None] - places).abs().argmin(dim=1)
        count = torch.bincount(nearest, minlength=most)
        kept = count > FEWEST * len(values)
        if bool(kept[1:-1].all()):
            return places
        mean = torch.zeros(most).to(values).index_add(0, nearest, values) / count.clamp_min(1)
        inner = torch.where(count > 0, mean, places)[1:-1]
        places = torch.cat([places[:1], inner, places[-1:]])
    kept[0] = kept[-1] = True
    return places[kept]


# First-order lag of a signal that is linear between samples, exact, and without a loop over them.
#
# τ ẏ = u − y,   y[k] = ρ y[k−1] + (g − ρ) u[k−1] + (1 − g) u[k],   ρ = exp(−dt/τ),  g = (1 − ρ)
# τ/dt T samples, C channels.

FORGOTTEN = 40.0  # lags after which nothing is left of an input, to rounding


def lagged(u: Tensor, lag: Tensor, dt: float) -> Tensor:
    """y (…, T, C) of u (…, T, C) by lags τ (C,) [s], from the steady state under the first sample.

    Differentiable in u and τ.
    """
    reach = FORGOTTEN * float(lag.detach().max()) / dt  # samples
    decay = torch.exp(-dt / lag)
    held = (1.0 - decay) * lag / dt
    later = (held - decay) * u[..., :-1, :] + (1.0 - held) * u[..., 1:, :]
    y = torch.cat([u[..., :1, :], later], dim=-2)
    shift, power = 1, decay
    while shift < min(reach, y.shape[-2]):  # y[k] holds Σ ρʲ of j < 2·shift
        y = y + pad(power * y[..., :-shift, :], (0, 0, shift, 0))
        shift, power = 2 * shift, power * power
    return y


def with_slope(u: Tensor, lag: Tensor, slope: Tensor, dt: float) -> tuple[Tensor, Tensor]:
    """`lagged`, and its derivative (…, T, C) by parameters of which the lags have a slope (C,)."""
    y, by_parameter, *_ = jvp(lambda lag: lagged(u, lag, dt), (lag,), (slope,))
    return y, by_parameter
