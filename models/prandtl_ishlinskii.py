"""Sliders in series with nonlinear springs: the force of a joint that slips, or has backlash.

r = r₀ + k s + c ṡ + Σ_j f_j(z_j),   z_j = min(max(z_j + ds, −l_j), l_j)
                        the model of Prandtl and Ishlinskii, generalised: Al Janaideh et al. (2011)

A spring f of any shape is in series with a slider: slack in its middle and stiff at its ends it
is backlash before friction; unlike at both ends, friction of unequal limits. The half widths l are
searched, all else is least squares (models/sliders/fit.py); no solver is needed.   T samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Annotated, Any

import torch
from torch import Tensor, nn

from data.annotations import NotNegative, Range
from data.record import Drive, Record, Response
from models.element_test import NIL, ElementTest
from models.estimator import Parameter
from models.sliders.fit import LINEAR, Motion, Sliders, fit_sliders, number_of

MOST_SLIDERS, MOST_NODES = 6, 200


class PrandtlIshlinskii(ElementTest):
    """Force (…, T, 1) from the imposed deformation s and rate ṡ of an element test.

    Every estimate is a free run. sliders: number; None: one more as long as that lowers the error
    by a fifth on the farthest motion, which is held back until then. nodes: of each spring's curve.
    ridge: ≥ 0, without unit, on scaled columns.

    A record that begins in an unknown state tells by its warm-up samples where its sliders stood.
    Raises ValueError for other channels than an element test's.
    """

    reads = ("f",)
    scale: Tensor  # (3,): half of the way of s [m], largest rate [m/s] and force [N]
    widths: Tensor  # (MOST_SLIDERS,), of the former; nil: no slider

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        sliders: Annotated[int, Range(1, MOST_SLIDERS)] | None = None,
        nodes: Annotated[int, Range(2, MOST_NODES)] = 16,
        ridge: NotNegative = 1e-6,
    ) -> None:
        super().__init__(dofs, inputs, dt)
        self.require_one_element()
        self.sliders, self.nodes, self.ridge = sliders, nodes, ridge
        empty = torch.full((LINEAR + MOST_SLIDERS * nodes,), torch.nan, dtype=torch.float64)
        self.weights = nn.Parameter(empty, requires_grad=False)
        self.register_buffer("widths", torch.zeros(MOST_SLIDERS, dtype=torch.float64))
        self.register_buffer("scale", torch.ones(3, dtype=torch.float64))

    def identify(self, batches: Iterable[Record]) -> dict[str, Any]:
        """Search the widths and solve for the springs; returns number and half widths [m]."""
        records = [record.to("cpu") for record in batches]
        self._measure(records)
        motions = [motion for record in records for motion in self._motions(record)]
        number, facts = self.sliders, dict[str, Any]()
        if number is None:
            number, errors = number_of(motions, MOST_SLIDERS, self.nodes, self.ridge)
            facts["held_out_error_percent"] = ", ".join(f"{100.0 * error:.2f}" for error in errors)
        law = fit_sliders(motions, number, self.nodes, self.ridge)
        self.widths.zero_()[:number] = law.widths
        self.weights.data.zero_()[: len(law.weights)] = law.weights
        sizes = (law.widths * self.scale[0].cpu()).tolist()
        return {"sliders": number, "half_widths": ", ".join(f"{w:.4g}" for w in sizes), **facts}

    @property
    def identified_parameters(self) -> int:
        sliders = int((self.widths > 0.0).sum())
        return LINEAR + sliders * (self.nodes + 1)

    def _measure(self, records: Sequence[Record]) -> None:
        """Set the units by what is fitted."""
        signals = []
        for record in records:
            self.require_force(record)
            both = torch.cat([record.excitation, record.a], dim=-1)
            signals.append(both[..., record.warmup :, :].reshape(-1, 3))
        least, most = torch.cat(signals).amin(dim=0), torch.cat(signals).amax(dim=0)
        sizes = torch.maximum(-least, most)
        sizes[0] = 0.5 * (most[0] - least[0])
        if not bool((sizes > 0.0).all()):
            raise ValueError(NIL)
        self.scale.copy_(sizes)

    def _motions(self, record: Record) -> list[Motion]:
        way, fastest, force = self.scale.cpu()
        u, r = record.excitation.cpu(), record.a.cpu().reshape(-1, record.samples) / force
        at_rest = record.initial_state != "unknown"
        return [
            Motion(s / way, rate / fastest, own, record.warmup, at_rest)
            for (s, rate), own in zip(u.reshape(-1, record.samples, 2).mT, r, strict=True)
        ]

    def _physical_parameters(self) -> Iterable[Parameter]:
        """r₀, k, c and half widths; springs in series are curves, which no single number states."""
        self.require_identified(self.weights)
        way, fastest, force = self.scale.tolist()
        about = "under s and its rate"
        units = (
            (force, "N", "offset"),
            (force / way, "N/m", "stiffness_beside_the_sliders"),
            (force / fastest, "N s/m", "damping"),
        )
        for value, (size, unit, name) in zip(self.weights[:LINEAR].tolist(), units, strict=True):
            yield Parameter(f"r1.{name}", value * size, unit, about)
        for j, width in enumerate(w for w in self.widths.tolist() if w > 0.0):
            yield Parameter(f"r1.slider_{j + 1}.half_width", width * way, "m", about)

    def forward(self, record: Record) -> Tensor:
        """Forces (…, T, 1) of the free run of a record or a batch."""
        return self.run_of(record).a

    def free_run(self, drive: Drive) -> Response:
        """Forces as `a`, from sliders without stretch; x and v are the imposed motion."""
        s = drive.u[..., :1]
        return self.run_of(Record(drive.dt, torch.zeros_like(s), drive.u[..., :0], s=s,
                                  s_dot=drive.u[..., 1:], quantity="force"))  # fmt: skip

    def run_of(self, record: Record) -> Response:
        """The free run of a record, its sliders where the warm-up samples tell."""
        self.require_identified(self.weights)
        widths = self.widths.cpu()
        widths = widths[widths > 0.0]
        weights = self.weights.detach().cpu()[: LINEAR + len(widths) * self.nodes]
        law = Sliders(widths, weights, self.nodes)
        forces = torch.stack([law.forces(motion) for motion in self._motions(record)])
        s, rate = record.excitation.split(1, dim=-1)
        return Response(s, rate, (forces * self.scale[2].cpu()).reshape(s.shape).to(s.device))
