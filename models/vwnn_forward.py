"""Forward VWNN: a Volterra/Wiener network that simulates a structure on its own accelerations.

The weights W of the network are identified by least squares on measured signals, then by
Gauss–Newton on the error of the free run. Filters, sigmoids and head are those of Brewick & Masri
(2016), Sect. 2.1; the rest is not in the paper.

ξ = filtered ẍ, ψ = filtered f,   ẍ̂ = Wᵀ [ξ, φ(Δξ), f, ψ],   φ = odd products of sigmoids

Δξ are the differences of ξ between every two masses, and ξ itself: restoring forces arise between
masses or against the ground, so products stay within one such link. First and third order only, as
the forces are odd.   R records, T samples, n DOFs, m filters, L = n(n+1)/2 links, P features.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations

import torch
from torch import Tensor

from data.annotations import Count, NotNegative, Whole
from data.record import Drive, Record, Response
from models.estimator import Estimator, weight_matrix
from models.layers.features import SigmoidProducts
from models.layers.filters import SlowCascades
from models.layers.integrate import History, integrated, one_by_one
from models.layers.least_squares import LeastSquares, require_solvable

CHUNK = 1 << 14  # samples whose features are held in memory at a time
DAMPING = (1e-1, 1e-3, 1e-5, 1e-7, 1e-9)  # of a Gauss–Newton step, on scaled columns
ROWS = 5  # every so many samples a row of Gauss–Newton: neighbours repeat one another
UNSTABLE = 2.0  # a free run whose error is so many times the motion has diverged
LARGEST_RIDGE = 1e3  # there nothing is left of the model


class ForwardVWNN(Estimator):
    """Reads accelerations and excitation of the training records; simulates from excitation alone.

    cutoffs: poles from slow to fast [rad/s], see SlowCascades; below the slowest one displacements
    are forgotten, so it should lie below the structure's frequencies.
    factors: number of filter outputs that enter products, pseudo-velocity first.
    sigmoid_weight: λ over the RMS of each channel in the training records, so without unit.
    order: of the products, odd for odd restoring forces.
    ridge: on scaled columns, where the search begins: it rises tenfold while the free run of the
    training records diverges or a rise makes it better. refinements: Gauss–Newton steps.
    """

    reads = ("a", "f")
    scale: Tensor

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        cutoffs: Sequence[float] = (0.3, 0.4, 1.0, 4.0, 16.0, 50.0, 100.0, 200.0),
        factors: Count = 4,
        sigmoid_weight: float = 0.5,
        order: int | Sequence[int] = (1, 3),
        ridge: NotNegative = 1e-9,
        refinements: Whole = 3,
    ) -> None:
        super().__init__(dofs, inputs, dt)
        if factors > len(cutoffs):
            raise ValueError(
                f"model.factors={factors}: expected 1 to {len(cutoffs)}, the number of cutoffs"
            )
        self.factors, self.ridge, self.refinements = factors, ridge, refinements
        self.filters = SlowCascades(cutoffs, dt)
        self.products = SigmoidProducts(factors, sigmoid_weight, order, bias=False)
        self.links = [(i,) for i in range(dofs)] + list(combinations(range(dofs), 2))
        self.linear = len(cutoffs) * dofs  # features ξ; then products, f, ψ
        self.own = self.linear + len(self.links) * self.products.features
        rows = self.own + inputs * (1 + len(cutoffs))
        require_solvable(
            dofs * rows,
            f"model.cutoffs and model.factors, with {dofs} DOFs and {inputs} inputs,",
            "take fewer cutoffs or factors",
        )
        self.weights = weight_matrix(rows, dofs)
        self.register_buffer("scale", torch.ones(len(self.links), factors, dtype=torch.float64))

    def observation(self) -> tuple[Tensor, Tensor]:
        """Matrices from the filters' state, flat, to ξ (m·n) and to the scaled Δξ (L·factors)."""
        to_xi = torch.kron(self.filters.outputs.T.contiguous(), torch.eye(self.dofs).to(self.scale))
        incidence = self.scale.new_zeros(self.dofs, len(self.links))
        for link, (mass, *other) in enumerate(self.links):
            incidence[mass, link] = 1.0
            incidence[other, link] = -1.0
        first = to_xi[:, : self.factors * self.dofs].unflatten(1, (self.factors, self.dofs))
        to_links = (first @ incidence).transpose(1, 2) / self.scale  # (state, L, factors)
        return to_xi, to_links.flatten(1)

    def own_features(self, state: Tensor) -> Tensor:
        """[ξ, φ(Δξ)] (…, own) of states (…, (m + 2)·n)."""
        to_xi, to_links = self.observation()
        return torch.cat([state @ to_xi, self.of_links(state @ to_links)], dim=-1)

    def of_links(self, xi: Tensor) -> Tensor:
        return self.products(xi.unflatten(-1, tuple(self.scale.shape))).flatten(-2)

    def driven_features(self, u: Tensor) -> Tensor:
        """[f, ψ] (…, T, (1 + m)·inputs): known before the run."""
        return torch.cat([u, (self.filters.outputs @ self.filters.states(u)).flatten(-2)], dim=-1)

    def features(self, record: Record) -> Iterator[tuple[slice, Tensor]]:
        """Features (…, CHUNK, P) from measured accelerations, with the samples they cover."""
        states = self.filters.states(record.a).flatten(-2)
        driven = self.driven_features(record.excitation)
        chunk = max(1, CHUNK // record.a[..., 0, 0].numel())
        for start in range(0, record.samples, chunk):
            span = slice(start, min(start + chunk, record.samples))
            phi = self.own_features(states[..., span, :])
            yield span, torch.cat([phi, driven[..., span, :]], dim=-1)

    def forward(self, record: Record) -> Tensor:
        self.require_identified(self.weights)
        return torch.cat([phi @ self.weights for _, phi in self.features(record)], dim=-2)

    def free_run(self, drive: Drive) -> Response:
        """The motion from filters at rest, whatever the initial state.

        x and v are integrals of the estimated accelerations, and drift.
        """
        self.require_identified(self.weights)
        return integrated(self.run(drive.u)[0], drive)

    def run(self, u: Tensor) -> tuple[Tensor, Tensor]:
        """Own accelerations (…, T, n) and the filters' states (…, T, (m + 2)·n) before each."""
        to_xi, to_links = self.observation()
        advance, enter = self._transition()
        linear, products, driven = self.weights.split(
            [self.linear, self.own - self.linear, len(self.weights) - self.own]
        )
        together = torch.cat([to_xi @ linear, to_links, advance], dim=1)
        widths = [self.dofs, to_links.shape[1], advance.shape[1]]
        state = u.new_zeros(*u.shape[:-2], advance.shape[0])
        history = History()
        for force in one_by_one(self.driven_features(u) @ driven):
            before = state
            linear_part, xi, state = (state @ together).split(widths, dim=-1)
            a = force + linear_part + self.of_links(xi) @ products
            state = state + a @ enter
            history.add(a, before)
        own, states = history.signals()
        return own, states

    def _transition(self) -> tuple[Tensor, Tensor]:
        """state[k+1] = state[k] A + a[k] B, on flat states."""
        A, b = self.filters.transition()
        eye = torch.eye(self.dofs).to(b)
        return torch.kron(A.T.contiguous(), eye), torch.kron(b[None, :], eye)

    def slopes(self, states: Tensor) -> Tensor:
        """∂ẍ̂/∂state (R, T, n, (m + 2)·n) at every sample of a run."""
        with torch.enable_grad():
            at = states.detach().requires_grad_()
            a = self.own_features(at) @ self.weights[: self.own]
            slopes = [torch.autograd.grad(u.sum(), at, retain_graph=True) for u in a.unbind(dim=-1)]
        return torch.stack([slope for (slope,) in slopes], dim=-2)

    def sensitivities(
        self, states: Tensor, driven: Tensor, local: Tensor, length: Tensor
    ) -> Iterator[Tensor]:
        """∂ẍ̂[k]/∂W (R, n, n·P) for every sample: each weight acts at k and through its past."""
        advance, enter = (matrix.T.contiguous() for matrix in self._transition())
        phi = torch.cat([self.own_features(states), driven], dim=-1) / length
        R, T, P = phi.shape
        past = phi.new_zeros(R, len(advance), self.dofs * P)
        for k in range(T):
            S = local[:, k] @ past
            for j in range(self.dofs):
                S[:, j, j * P : (j + 1) * P] += phi[:, k]
            yield S
            past = advance @ past + enter @ S

    @torch.no_grad()
    def identify(self, batches: Iterable[Record]) -> dict[str, float]:
        """Least squares with the ridge that suits the free run best, then Gauss–Newton.

        Returns the ridge used, the error of the free run of the training records [%] before and
        after the refinements, and how many refinements were accepted.
        """
        self._fit_scale(batches)
        fit = LeastSquares(self.ridge)
        for record in batches:
            for span, phi in self.features(record):
                counted = max(record.warmup - span.start, 0)
                fit.add(phi[..., counted:, :], record.a[..., span, :][..., counted:, :])
        assert fit.triangle is not None
        length = torch.linalg.vector_norm(fit.triangle[:, : fit.features], dim=0)
        facts, error = self._choose_ridge(fit, batches)
        facts["free_run_percent_before_refinement"] = 100.0 * error
        accepted = 0
        while accepted < self.refinements and error < UNSTABLE:
            refined = self._refine(batches, torch.where(length > 0.0, length, 1.0), error)
            if refined >= error:
                break
            error, accepted = refined, accepted + 1
        return {**facts, "free_run_percent": 100.0 * error, "refinements": float(accepted)}

    def _fit_scale(self, batches: Iterable[Record]) -> None:
        self.scale.fill_(1.0)
        _, to_links = self.observation()
        squares, samples = torch.zeros_like(self.scale).flatten(), 0
        for record in batches:
            xi = self.filters.states(record.a).flatten(-2) @ to_links
            squares += xi.square().flatten(0, -2).sum(dim=0)
            samples += xi[..., 0].numel()
        rms = (squares / max(samples, 1)).sqrt().view_as(self.scale)
        self.scale.copy_(torch.where(rms > 0.0, rms, 1.0))

    def _choose_ridge(
        self, fit: LeastSquares, batches: Iterable[Record]
    ) -> tuple[dict[str, float], float]:
        best, error = fit.solve(), float("inf")
        used = fit.ridge
        while True:
            solution = fit.solve()
            self.weights.copy_(solution.weights)
            tried = self._free_run_error(batches)
            if tried < error:
                best, error, used = solution, tried, fit.ridge
            elif error < UNSTABLE or fit.ridge >= LARGEST_RIDGE:
                break
            fit.ridge = max(10.0 * fit.ridge, 1e-12)
        self.weights.copy_(best.weights)
        return {"rank": best.rank, "condition": best.condition, "ridge": used}, error

    def _free_run_error(self, batches: Iterable[Record]) -> float:
        """‖ẍ̂ − ẍ‖/‖ẍ‖ of the free runs of the records; infinite where they diverge."""
        wrong = right = 0.0
        for record in batches:
            a = record.counted(record.a)
            own = record.counted(self.run(record.excitation)[0])
            wrong, right = wrong + float((own - a).square().sum()), right + float(a.square().sum())
        error = (wrong / right) ** 0.5 if right > 0.0 else float("inf")
        return error if error < UNSTABLE else float("inf")

    def _refine(self, batches: Iterable[Record], length: Tensor, error: float) -> float:
        """One Gauss–Newton step, with the damping that suits the free run best; its error.

        The weights stay as they were where no damping lowers the error.
        """
        before = best = self.weights.clone()
        normal, gradient = self._normal_equations(batches, length)
        if not normal.diagonal().any():
            return error  # nothing drives the run, so that no weight moves it
        eye = torch.eye(len(normal)).to(normal) * normal.diagonal().mean()
        for damping in DAMPING:
            step = torch.linalg.solve(normal + damping * eye, gradient)
            self.weights.copy_(before + step.view(self.dofs, -1).T / length[:, None])
            tried = self._free_run_error(batches)
            if tried < error:
                best, error = self.weights.clone(), tried
        self.weights.copy_(best)
        return error

    def _normal_equations(self, batches: Iterable[Record], length: Tensor) -> tuple[Tensor, Tensor]:
        """SᵀS (n·P, n·P) and Sᵀe (n·P), S = ∂ẍ̂/∂W through the whole run, scaled by 1/length."""
        size = self.weights.numel()
        normal, gradient = self.weights.new_zeros(size, size), self.weights.new_zeros(size)
        for record in batches:
            batch = record if record.a.ndim == 3 else record.map(lambda u: u[None])
            own, states = self.run(batch.excitation)
            local = self.slopes(states)
            driven = self.driven_features(batch.excitation)
            missed = batch.a - own
            for k, S in enumerate(self.sensitivities(states, driven, local, length)):
                if k >= record.warmup and k % ROWS == 0:
                    rows = S.flatten(0, 1)
                    normal.addmm_(rows.T, rows)
                    gradient.addmv_(rows.T, missed[:, k].flatten())
        return normal, gradient
