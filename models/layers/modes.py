"""Real modes of a matrix that need not be symmetric, such as an identified M⁻¹K."""

from __future__ import annotations

import torch
from torch import Tensor


def real_modes(matrix: Tensor) -> Tensor:
    """Real basis Φ (n, n) of the eigenvectors of a real matrix, columns of unit length.

    Ordered by the eigenvalues' real part. A complex pair gives its real and imaginary part.
    """
    values, vectors = torch.linalg.eig(matrix)
    columns, order = [], torch.argsort(values.real)
    for i in order.tolist():
        if values[i].imag == 0.0:
            columns.append(vectors[:, i].real)
        elif values[i].imag > 0.0:
            columns += [vectors[:, i].real, vectors[:, i].imag]
    modes = torch.stack(columns, dim=1)
    return modes / torch.linalg.vector_norm(modes, dim=0)
