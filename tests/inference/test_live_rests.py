"""Rests in a signal that goes on are those of the whole."""

import torch

from tex_lightning.inference.live_rests import LiveRests
from tex_lightning.senses.features.movement import left_out

RATE = 10_000


def test_rests_are_those_of_the_whole_where_the_level_is_known():
    samples = torch.randn(1, 5 * RATE, generator=torch.Generator().manual_seed(0))
    samples[:, RATE : 2 * RATE] *= 1e-3
    samples[:, 32_000] += 500  # a knock
    samples[:, 7 * RATE // 2 : 4 * RATE] *= 1e-3
    rests, parts, movement = LiveRests(RATE, skip=True), [], []
    for part in samples.split(777, dim=1):
        settled, rest = rests.push(part, part[:, :0])
        parts.append(settled.left_out)
        movement.append(settled.movement)
    found = torch.cat([*parts, rest.left_out])
    assert torch.equal(found, left_out(samples, RATE))
    assert torch.equal(torch.cat([*movement, rest.movement], dim=1), samples[:, ~found])
    assert 1.4 * RATE < int(found.sum()) < 1.7 * RATE
    assert found[32_000]
