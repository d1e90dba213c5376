"""The rows that the steps of a fit look at, and what a fit on some of them at a time is worth."""

from __future__ import annotations

import pytest
import torch

from guard_algos.critics import Critic
from guard_algos.minibatches import minibatches
from guard_algos.networks import Mlp
from guard_algos.workers import workers


def test_every_pass_takes_every_row_once_in_another_order() -> None:
    drawn = torch.stack([rows for rows in minibatches(12, 4, 6, seed=1) if isinstance(rows, torch.Tensor)])
    first, second = drawn[:3].flatten(), drawn[3:].flatten()
    assert sorted(first.tolist()) == sorted(second.tolist()) == list(range(12))
    assert first.tolist() != second.tolist()


@pytest.mark.parametrize(("size", "batch_size", "count"), [(10, 4, 7), (10, 4, 1), (5, 5, 3), (5, 9, 2), (7, 3, 0)])
def test_there_are_as_many_as_asked_of_the_same_size(size: int, batch_size: int, count: int) -> None:
    lengths = [len(torch.arange(size)[rows]) for rows in minibatches(size, batch_size, count, seed=0)]
    assert lengths == [min(size, batch_size)] * count


def test_the_seed_decides_the_rows() -> None:
    def drawn(seed: int) -> list[list[int]]:
        return [torch.arange(9)[rows].tolist() for rows in minibatches(9, 3, 5, seed)]

    assert drawn(3) == drawn(3) != drawn(4)


def test_a_critic_fitted_by_minibatches_explains_its_targets_as_on_the_full_batch() -> None:
    x = torch.randn(3000, 3, generator=torch.Generator().manual_seed(0))
    target = torch.sin(x[:, 0]) + 0.5 * x[:, 1] * x[:, 2]
    after = {}
    for batch_size in (300, 3000):
        critic = Critic(Mlp((3, 32, 1)), torch.Generator().manual_seed(1), 0.01)
        with workers(1) as pool:
            before, after[batch_size] = critic.fit(x, target, 200, batch_size, pool)
    assert max(after.values()) < 0.03 * before
