"""Forward VWNN: a Volterra/Wiener network that simulates a structure on its own accelerations.

The weights W of the network (vwnn_forward_network.py) are identified by least squares on measured
signals, then by Gauss–Newton on the error of the free run. Filters, sigmoids and head are those of
Brewick & Masri (2016), Sect. 2.1; the rest is not in the paper.   n DOFs, P features.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import torch
from torch import Tensor

from data.record import Record
from models.layers.least_squares import LeastSquares, require_ridge
from models.vwnn_forward_network import ForwardNetwork

DAMPING = (1e-1, 1e-3, 1e-5, 1e-7, 1e-9)  # of a Gauss–Newton step, on scaled columns
ROWS = 5  # every so many samples a row of Gauss–Newton: neighbours repeat one another
UNSTABLE = 2.0  # a free run whose error is so many times the motion has diverged
LARGEST_RIDGE = 1e3  # there nothing is left of the model


class ForwardVWNN(ForwardNetwork):
    """Reads accelerations and excitation of the training records; simulates from excitation alone.

    cutoffs: poles from slow to fast [rad/s], see SlowCascades; below the slowest one displacements
    are forgotten, so it should lie below the structure's frequencies.
    factors: number of filter outputs that enter products, pseudo-velocity first.
    sigmoid_weight: λ over the RMS of each channel in the training records, so without unit.
    order: of the products, odd for odd restoring forces.
    ridge: on scaled columns, where the search begins: it rises tenfold while the free run of the
    training records diverges or a rise makes it better. refinements: Gauss–Newton steps.
    """

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        cutoffs: Sequence[float] = (0.3, 0.4, 1.0, 4.0, 16.0, 50.0, 100.0, 200.0),
        factors: int = 4,
        sigmoid_weight: float = 0.5,
        order: int | Sequence[int] = (1, 3),
        ridge: float = 1e-9,
        refinements: int = 3,
    ) -> None:
        super().__init__(dofs, inputs, dt, cutoffs, factors, sigmoid_weight, order)
        if refinements < 0:
            raise ValueError(f"model.refinements={refinements} must not be negative")
        require_ridge(ridge)
        self.ridge, self.refinements = ridge, refinements

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
        facts["free_run_percent_unrefined"] = 100.0 * error
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
            self.check(record)
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
            a = record.a[..., record.warmup :, :]
            own = self.run(record.excitation)[0][..., record.warmup :, :]
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
