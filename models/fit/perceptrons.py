"""Mean squares of perceptrons, their slopes and normal equations in closed form, many at once.

e = w (g(u; θ) − y), with w = √N/‖ẍ‖ of problem.py.   Hagan & Menhaj (1994)
A row of the Jacobian by the weights of layer i is δᵢ ⊗ hᵢ, of what leaves the layer and what enters
it. So JᵀJ is summed from products (δᵢ δⱼᵀ) ⊗ (hᵢ hⱼᵀ): outputs are added up before the weights are
multiplied, and J is never formed.
S networks of one shape, N samples of each, c inputs, n outputs, P weights θ (layer by layer: the
matrix, then the bias). Samples are the last dimension.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cache
from typing import Any

import torch
from torch import Tensor, nn

from models.layers.perceptron import SLOPES, Perceptron

BLOCK_ELEMENTS = 1 << 22  # of products or derivatives that are formed at a time (32 MiB)
GPU_BLOCK_ELEMENTS = 1 << 27  # the same on a GPU, which is slow to begin (1 GiB)


class Perceptrons:
    """Networks of one shape, each with samples u (N, c), targets y (N, n) and a weight w.

    One network alone (S = 1), or many by `joined`. Methods take θ (M, P) of those at `places`.
    """

    def __init__(self, network: Perceptron, u: Tensor, y: Tensor, weight: float) -> None:
        # the scalings are not trained: samples are scaled once
        self.u = network.input_scale(u).mT[None].contiguous()  # (S, c, N)
        self.y = network.output_scale(y).mT[None].contiguous()
        self.gain = weight * network.output_scale.reach[None, :, None]  # of errors in scaled units
        linear = [layer for layer in network.layers if isinstance(layer, nn.Linear)]
        self.shapes = [(layer.out_features, layer.in_features) for layer in linear]
        self.activation = network.layers[1]
        self.slope = SLOPES[type(self.activation)]
        self.order = _order(tuple(self.shapes)).to(u.device)

    @classmethod
    def joined(cls, one: Sequence[Perceptrons]) -> Perceptrons:
        """All of them as one. Raises ValueError for networks or samples of different shapes."""
        together = copy(one[0])
        if len({(*other.shapes, type(other.activation), other.u.shape[1:]) for other in one}) > 1:
            raise ValueError("networks of different shapes cannot be trained side by side")
        for name in ("u", "y", "gain"):
            setattr(together, name, torch.cat([getattr(other, name) for other in one]))
        return together

    def bytes_of_one(self) -> float:
        """What one network keeps: samples, three signals of each neuron, four matrices (P, P)."""
        neurons = sum(rows for rows, _ in self.shapes)
        signals = self.u.shape[1] + self.y.shape[1] + 3 * neurons
        return 8.0 * (signals * self.u.shape[-1] + 4 * len(self.order) ** 2)

    def losses(self, theta: Tensor, places: Any = slice(None)) -> Tensor:
        """Mean square (M,) of the errors of each network."""
        e = self.gain[places] * (self._run(theta, self.u[places])[0] - self.y[places])
        return e.square().mean(dim=(1, 2))

    def slopes(self, theta: Tensor, places: Any = slice(None)) -> tuple[Tensor, Tensor]:
        """Mean squares (M,) and their gradients (M, P)."""
        out, entering, slopes = self._run(theta, self.u[places])
        gain = self.gain[places]
        e = gain * (out - self.y[places])
        delta = (2.0 / e[0].numel()) * gain * e
        parts: list[Tensor] = []
        for i, (W, _) in reversed(list(enumerate(self._layers(theta)))):
            parts[:0] = [(delta @ entering[i].mT).flatten(1), delta.sum(dim=-1)]
            if i:
                delta = (W.mT @ delta) * slopes[i - 1]
        return e.square().mean(dim=(1, 2)), torch.cat(parts, dim=1)

    def squares(self, theta: Tensor, every: int = 1, places: Any = slice(None)) -> Tensor:
        """JᵀJ (M, P, P), J = ∂e/∂θ, summed over every `every`-th sample and scaled up."""
        u, gain = self.u[places][..., ::every].contiguous(), self.gain[places]
        widest = max(max(rows**2, (columns + 1) ** 2) for rows, columns in self.shapes)
        block = BLOCK_ELEMENTS if u.device.type == "cpu" else GPU_BLOCK_ELEMENTS
        longest = max(1, block // (len(u) * widest))
        parts = [self._squares(theta, block, gain) for block in u.split(longest, dim=-1)]
        scaled_up = self.u.shape[-1] / u.shape[-1]
        return scaled_up * torch.stack(parts).sum(dim=0)[:, self.order[:, None], self.order]

    def _layers(self, theta: Tensor) -> list[tuple[Tensor, Tensor]]:
        """Matrix (M, rows, columns) and bias (M, rows, 1) of each layer."""
        sizes = [size for rows, columns in self.shapes for size in (rows * columns, rows)]
        parts = theta.split(sizes, dim=1)
        return [
            (W.unflatten(1, shape), b[..., None])
            for W, b, shape in zip(parts[::2], parts[1::2], self.shapes, strict=True)
        ]

    def _run(self, theta: Tensor, u: Tensor) -> tuple[Tensor, list[Tensor], list[Tensor]]:
        """Outputs (M, n, N); what enters each layer; slopes of the activations."""
        layers = self._layers(theta)
        entering, slopes = [u], []
        for W, b in layers[:-1]:
            z = torch.baddbmm(b, W, entering[-1])
            h = self.activation(z)
            slopes.append(self.slope(z, h))
            entering.append(h)
        W, b = layers[-1]
        return torch.baddbmm(b, W, entering[-1]), entering, slopes

    def _squares(self, theta: Tensor, u: Tensor, gain: Tensor) -> Tensor:
        """JᵀJ of some samples, each layer's weights row by row with their bias."""
        _, entering, slopes = self._run(theta, u)
        layers, last = self._layers(theta), len(self.shapes) - 1
        with_one = [torch.cat([h, torch.ones_like(h[:, :1])], dim=1) for h in entering]
        delta = [gain[..., None] * torch.eye(gain.shape[1]).to(u)[..., None]]  # (M, n, rows, N)
        for i in range(last, 0, -1):
            delta.insert(0, (layers[i][0].mT[:, None] @ delta[0]) * slopes[i - 1][:, None])
        blocks: dict[tuple[int, int], Tensor] = {}
        for i in range(last + 1):
            for j in range(i, last + 1):
                leaving = _outer_sums(delta[i], delta[j])
                together = with_one[i][:, :, None] * with_one[j][:, None]
                leaving = leaving.flatten(1, 2).expand(-1, -1, u.shape[-1])
                sums = leaving @ together.flatten(1, 2).mT
                (rows, columns), (others, more) = self.shapes[i], self.shapes[j]
                sums = sums.unflatten(2, (columns + 1, more + 1)).unflatten(1, (rows, others))
                blocks[i, j] = sums.transpose(2, 3).flatten(3).flatten(1, 2)
                blocks[j, i] = blocks[i, j].mT
        places = range(last + 1)
        return torch.cat([torch.cat([blocks[i, j] for j in places], dim=2) for i in places], dim=1)


def _outer_sums(first: Tensor, second: Tensor) -> Tensor:
    """Σ over outputs of δᵢ δⱼᵀ (M, rows, rows, N), without the products of all outputs at once."""
    total = first[:, 0, :, None] * second[:, 0, None]
    for output in range(1, first.shape[1]):
        total.addcmul_(first[:, output, :, None], second[:, output, None])
    return total


class JointEvaluation:
    """Networks that are trained in threads of their own, and whose questions are answered together.

    An answer is computed when all that are still in training have asked: which networks share it
    does not depend on the threads' speed.
    """

    def __init__(self, networks: Perceptrons) -> None:
        self.networks, self.present = networks, set(range(len(networks.u)))
        self.asked: dict[int, tuple[tuple[Any, ...], Tensor]] = {}
        self.answers: dict[int, Any] = {}
        self.changed = threading.Condition()

    def ask(self, place: int, theta: Tensor, *question: Any) -> Any:
        """A method of `Perceptrons` and what else it takes, about the network at a place."""
        with self.changed:
            self.asked[place] = question, theta
            self._answer()
            self.changed.wait_for(lambda: place in self.answers)
            answer = self.answers.pop(place)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def leave(self, place: int) -> None:
        """The network at a place is trained, or its training failed."""
        with self.changed:
            self.present.discard(place)
            self._answer()

    def _answer(self) -> None:
        if not self.asked or len(self.asked) < len(self.present):
            return
        for question in dict.fromkeys(question for question, _ in self.asked.values()):
            places = sorted(p for p, (other, _) in self.asked.items() if other == question)
            theta = torch.cat([self.asked[place][1] for place in places])
            all_of_them = len(places) == len(self.networks.u)
            at = slice(None) if all_of_them else torch.tensor(places, device=theta.device)
            name, *more = question
            try:
                found = getattr(self.networks, name)(theta, *more, places=at)
                several = found if isinstance(found, tuple) else (found,)
                for row, place in enumerate(places):
                    own = tuple(part[row : row + 1] for part in several)
                    self.answers[place] = own if isinstance(found, tuple) else own[0]
            except Exception as error:  # of memory: nobody waits for an answer that does not come
                self.answers |= dict.fromkeys(places, error)
        self.asked = {}
        self.changed.notify_all()


@dataclass(frozen=True)
class Member:
    """One network of a joint evaluation, asked as if it were alone."""

    joint: JointEvaluation
    place: int

    def losses(self, theta: Tensor) -> Tensor:
        return self.joint.ask(self.place, theta, "losses")

    def slopes(self, theta: Tensor) -> tuple[Tensor, Tensor]:
        return self.joint.ask(self.place, theta, "slopes")

    def squares(self, theta: Tensor, every: int = 1) -> Tensor:
        return self.joint.ask(self.place, theta, "squares", every)


@cache
def _order(shapes: tuple[tuple[int, int], ...]) -> Tensor:
    """Where the weights θ are in rows of [matrix, bias]."""
    places, start = [], 0
    for rows, columns in shapes:
        own = start + torch.arange(rows * (columns + 1)).view(rows, columns + 1)
        places += [own[:, :-1].flatten(), own[:, -1]]
        start += own.numel()
    return torch.cat(places)
