"""The free run of a model as a `scan` over time: what torch.export and ONNX take, at any length.

    forward(u (B, T, m), x0 (B, n), v0 (B, n)) → x, v, a (B, T, n)

Every number that single precision does not hold exactly is a buffer of double precision: a number
of Python's becomes one of single precision in ONNX. What a step reads is a buffer of its
own: `scan` takes no two views of one. B runs, T samples, n DOFs, m excitations.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from torch import Tensor, nn
from torch._higher_order_ops.scan import scan

Step = Callable[[tuple[Tensor, ...], tuple[Tensor, ...]], tuple[tuple[Tensor, ...], Tensor]]


class Graph(nn.Module):
    """Base: what leaves the loop over time. `held`: the excitation holds between samples."""

    def __init__(self, held: bool) -> None:
        super().__init__()
        self.held = held

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...  # buffers

    def keep(self, **numbers: Tensor) -> None:
        """Have numbers as buffers."""
        for name, value in numbers.items():
            self.register_buffer(name, value.detach().clone().contiguous())

    def through_time(self, step: Step, begin: tuple[Tensor, ...], u: Tensor) -> Tensor:
        """What `step` puts out (B, T − 1, ·) of (u[k − 1], u[k]), from a carried state."""
        first, last = u[:, :-1].transpose(0, 1), u[:, 1:].transpose(0, 1)
        _, out = scan(step, begin, (first.contiguous(), last.contiguous()), dim=0)
        return out.transpose(0, 1)
