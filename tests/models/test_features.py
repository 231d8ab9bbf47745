"""Sigmoids and their products: how many, which, and their symmetry."""

from __future__ import annotations

import math
from itertools import combinations_with_replacement

import pytest
import torch

from models.layers.features import SigmoidProducts

XI = torch.randn(50, 12, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


@pytest.mark.parametrize(
    ("order", "squares", "bias", "count"),
    [
        (1, True, True, 13),
        (2, True, False, 90),
        (2, False, False, 78),
        (3, True, True, 455),
        (3, False, False, 298),
    ],
)
def test_the_number_of_features_is_that_of_the_unique_products(order, squares, bias, count):
    phi = SigmoidProducts(12, 0.1, order, squares, bias)
    assert phi.features == count
    assert phi(XI).shape == (50, count)
    assert torch.unique(phi(XI), dim=1).shape[1] == count


def test_first_order_terms_are_eq_6():
    h = SigmoidProducts(12, 0.3, 1, bias=False)(XI)
    assert torch.allclose(h, 2.0 / (1.0 + torch.exp(-2.0 * 0.3 * XI)) - 1.0, rtol=0, atol=1e-15)
    assert torch.allclose(h, torch.tanh(0.3 * XI), rtol=0, atol=1e-15)


def test_products_are_those_of_the_first_order_terms():
    phi, h = SigmoidProducts(3, 0.7, 3)(XI[:, :3]), torch.tanh(0.7 * XI[:, :3])
    by_hand = [
        math.prod(h[:, i] for i in factors)
        for count in (1, 2, 3)
        for factors in combinations_with_replacement(range(3), count)
    ]
    by_hand.append(torch.ones(50).double())
    assert torch.allclose(phi, torch.stack(by_hand, dim=1), rtol=1e-14)


def test_odd_orders_turn_with_the_motion_and_even_orders_do_not():
    features = SigmoidProducts(12, 0.3, 3)
    one, mirrored = features(XI), features(-XI)
    first, second, third = slice(0, 12), slice(12, 90), slice(90, 454)
    assert torch.equal(mirrored[:, first], -one[:, first])
    assert torch.equal(mirrored[:, second], one[:, second])
    assert torch.equal(mirrored[:, third], -one[:, third])
    assert torch.equal(one[:, 454], torch.ones(50).double())


@pytest.mark.parametrize(
    ("weight", "order", "message"),
    [
        (0.0, 2, r"weight=0\.0 must be a number above 0 or null"),
        (-0.1, 2, "above 0"),
        (math.nan, 2, "is not finite"),
        (math.inf, 2, "is not finite"),
        (0.1, 0, r"model\.order=0: choose 1, 2 or 3"),
        (0.1, 4, r"model\.order=4"),
    ],
)
def test_features_that_cannot_be_are_refused(weight, order, message):
    with pytest.raises(ValueError, match=message):
        SigmoidProducts(3, weight, order)


@pytest.mark.parametrize(
    "settings", [{}, {"order": 1}, {"order": [1, 3], "bias": False}, {"order": 3, "squares": False}]
)
def test_compiled_features_are_those_of_torch_to_the_bit(settings):
    activation = SigmoidProducts(5, 0.7, **settings)
    xi = torch.randn(2, 3, 50, 5, generator=torch.Generator().manual_seed(0)).double()
    assert torch.equal(activation.products_of(xi), activation(xi))
    strided = xi.transpose(1, 2)
    assert torch.equal(activation.products_of(strided), activation(strided))
