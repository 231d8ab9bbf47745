"""Arrays of results lie where they are filled alike and soon."""

from __future__ import annotations

import pytest
import torch

from models.fit.room import LINE, room


@pytest.mark.parametrize("shape", [(0,), (1,), (3, 5), (2, 5000, 3)])
def test_room_begins_with_a_line_of_the_cache(shape):
    arrays = [room(*shape) for _ in range(3)]  # kept, so that each lies elsewhere
    for one in arrays:
        assert one.shape == shape
        assert one.dtype == torch.float64
        assert one.is_contiguous()
        assert one.numel() == 0 or one.data_ptr() % LINE == 0
