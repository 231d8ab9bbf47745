"""Polynomial NARX: a(t_k) as a polynomial of earlier accelerations and of forces, terms by FROLS.

SysIdentPy 0.9 (BSD), Lacerda et al. (2020), doi 10.21105/joss.02384; Billings (2013), Sect. 3.2.
Terms are chosen as its examples of structures do: least squares, BIC over up to `TERMS` terms.
The package has one output, so there is a model per DOF, driven by the forces at all DOFs.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np

from data.record import Drive, Record

DEGREE = 2
LAGS = (1, 2, 5, 10, 15, 20)  # samples, of the acceleration and, less one, of each force
TERMS = 39  # n_info_values of the package's vibration examples
PACKAGE = "sysidentpy"


def at_rest(signal: np.ndarray) -> np.ndarray:
    """A signal (T, c) after as many samples at rest as the lags need."""
    return np.concatenate([np.zeros((max(LAGS), signal.shape[1])), signal])


def present(f: np.ndarray) -> np.ndarray:
    """Forces (T, m) a sample early: the package's lags begin at 1, an acceleration's force at 0."""
    return np.concatenate([f[1:], f[-1:]])


def regression(records: list[Record]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Forces (N, m), accelerations (N, n), and which rows of the regression lie in one record.

    No samples at rest: the package's Householder reflections fail where a column begins with 0.
    """
    within = np.concatenate([np.arange(record.samples) >= max(LAGS) for record in records])
    f = np.concatenate([present(record.f.numpy()) for record in records])
    a = np.concatenate([record.a.numpy() for record in records])
    return f, a, within[max(LAGS) :]


def chosen(within: np.ndarray, inputs: int) -> Any:
    """The package's FROLS on the rows `within` records; terms for BIC are ranked only once."""
    frols = import_module("sysidentpy.model_structure_selection").FROLS
    basis = import_module("sysidentpy.basis_function").Polynomial
    estimation = import_module("sysidentpy.parameter_estimation").LeastSquares

    class FROLS(frols):  # type: ignore[misc, valid-type]
        def run_mss_algorithm(self, psi: np.ndarray, y: np.ndarray, terms: int) -> tuple:
            """The first `terms` of a greedy choice are those of a longer one."""
            if not hasattr(self, "ranked"):
                self.rows = psi[within]
                self.target = y[self.max_lag :][within]
                target = np.concatenate([y[: self.max_lag], self.target])
                self.ranked = self.error_reduction_ratio(self.rows, target, self.n_info_values)
            err, order, _ = self.ranked
            return err, order[:terms], self.rows[:, order[:terms]], self.target

    return FROLS(
        order_selection=True,
        info_criteria="bic",
        n_info_values=TERMS,
        xlag=[list(LAGS)] * inputs if inputs > 1 else list(LAGS),
        ylag=list(LAGS),
        estimator=estimation(),
        basis_function=basis(degree=DEGREE),
    )


def fit(records: list[Record], seed: int, seconds: float) -> Callable[[Drive], np.ndarray]:
    """A model per DOF; the choice of terms has no random part and ends by itself."""
    f, a, within = regression(records)
    models = []
    for i in range(a.shape[1]):
        model = chosen(within, f.shape[1])
        models.append(model.fit(X=f, y=a[:, i : i + 1]))

    def simulate(drive: Drive) -> np.ndarray:
        """Acceleration (T, n) from rest by the package's own free run."""
        f, rest = present(at_rest(drive.u.numpy())), np.zeros((max(LAGS), 1))
        return np.concatenate([m.predict(X=f, y=rest)[max(LAGS) :] for m in models], axis=1)

    return simulate
