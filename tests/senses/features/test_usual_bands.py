"""Empty bands of a lower rate: which they are, and what counts in their place."""

import pytest
import torch

from tex_lightning.senses.features.octave_bands import compared
from tex_lightning.senses.features.usual_bands import UsualBands

BANDS, GAP, FRAMES, THRESHOLDS = 12, 2, 4000, 5


def log_bands(seed: int = 0) -> torch.Tensor:
    """Bands that fall by 5 nepers and vary by 0.3, each by itself: (1, frames, bands)."""
    noise = torch.randn(1, FRAMES, BANDS, generator=torch.Generator().manual_seed(seed))
    return 0.3 * noise + torch.linspace(5, 0, BANDS)


def responses_of(logs: torch.Tensor, mean: torch.Tensor, slow: bool) -> torch.Tensor:
    return compared(logs, mean, GAP, 4 if slow else 3)


@pytest.fixture(params=[False, True], ids=["shape", "slow"])
def learnt(request) -> UsualBands:
    sizes = (BANDS, BANDS - GAP, BANDS, BANDS)[: 4 if request.param else 3]
    usual, logs = UsualBands(sizes, GAP, slow=request.param, apart=0), log_bands()
    usual.learn(responses_of(logs, logs.mean(dim=2, keepdim=True), request.param))
    return usual


@pytest.mark.parametrize("gain", [-6.0, 0.0, 6.0])
def test_the_highest_bands_are_empty_with_those_at_their_edge_and_leave_the_mean(learnt, gain):
    whole, cut = gain + log_bands(1), gain + log_bands(1)
    cut[:, :, -3:] -= 20
    before = whole.mean(dim=2, keepdim=True)
    kept, mean = learnt.without_empty(whole, before)
    assert torch.equal(kept, whole)
    assert torch.equal(mean, before)
    logs, mean = learnt.without_empty(cut, cut.mean(dim=2, keepdim=True))
    empty = logs.isnan().float().mean(dim=(0, 1))
    assert empty.tolist() == [0] * (BANDS - 3 - GAP) + [1] * (3 + GAP)
    assert (mean - before).square().mean().sqrt() < 0.2  # as noise in seven bands has it
    assert abs((mean - before).mean()) < 0.02
    learnt.forget()
    assert torch.equal(learnt.without_empty(cut, before)[0], cut)


def test_what_is_empty_has_usual_proportions_means_and_deviations(learnt):
    slow, whole, cut = learnt.slow, log_bands(1), log_bands(1)
    cut[:, :, -3:] -= 20
    mean = whole.mean(dim=2, keepdim=True)
    expected = responses_of(whole, mean, slow)
    found = responses_of(*learnt.without_empty(cut, cut.mean(dim=2, keepdim=True)), slow)
    assert not learnt.has_empty(expected)
    assert learnt.has_empty(found)
    shares = (torch.arange(THRESHOLDS) + 0.5) / THRESHOLDS
    limits = responses_of(log_bands(), log_bands().mean(dim=2, keepdim=True), slow)
    limits = limits.quantile(shares, dim=0)
    chosen = slice(None) if slow else slice(2 * BANDS - GAP)
    above, kept = learnt.fill(found, (found[:, None] > limits).float(), found[:, chosen])
    torch.testing.assert_close(
        above.mean(dim=0), (expected[:, None] > limits).float().mean(dim=0), atol=0.06, rtol=0
    )
    torch.testing.assert_close(kept.mean(dim=0), expected[:, chosen].mean(dim=0), atol=0.05, rtol=0)
    if slow:
        torch.testing.assert_close(kept.std(dim=0), expected.std(dim=0), atol=0.08, rtol=0)


def test_what_older_checkpoints_know_of_empty_bands_is_known(learnt):
    mean, depth = torch.linspace(5, 0, BANDS), torch.linspace(7, 9, BANDS)
    learnt.moments.copy_(learnt.of_older(torch.stack((mean, depth))))
    loaded = UsualBands(learnt.sizes, GAP, slow=learnt.slow, apart=0)
    loaded.load_state_dict(learnt.state_dict())
    torch.testing.assert_close(loaded.depth, depth)
    torch.testing.assert_close(loaded.moments[0, :BANDS], mean)
    torch.testing.assert_close(loaded.moments[0, BANDS : 2 * BANDS - GAP], mean[GAP:] - mean[:-GAP])
