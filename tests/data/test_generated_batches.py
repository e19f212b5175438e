"""Batches from the stream: endless, repeatable, the same for any number of processes."""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch.utils.data import DataLoader

from tex_lightning.data.generated_batches import LANES, GeneratedBatches, PhotoViews, TraceViews
from tex_lightning.features.image import crop_side
from tex_lightning.features.spectrogram import HapticFeatures


@dataclass(frozen=True)
class Numbered:
    """A stream whose photos say their number, and traces hum at a pitch of their class."""

    modality: str = "image"

    def class_of(self, number: int) -> int:
        return number % 5

    def render(self, number: int) -> list[np.ndarray]:
        if self.modality == "haptic":
            time = np.arange(20_000) / 10_000
            return [np.sin(time * 600 * (1 + number % 5))[None].astype(np.float32)]
        return [np.full((60, 90, 3), number % 251, np.uint8)]


def photos(batch_size=6, views=4, seed=0) -> GeneratedBatches:
    return GeneratedBatches(PhotoViews(Numbered(), 40, 30.0), batch_size, views, seed)


@given(st.integers(1, 12), st.integers(1, 12))
def test_every_specimen_is_viewed_as_often_and_keeps_its_place(batch_size, views):
    batches = photos(batch_size, views)
    shown = [batches.numbers(step) for step in range(LANES * 4 * views)]
    counts = Counter(number for numbers in shown for number in numbers)
    whole = [*range(LANES * (batch_size - 1), LANES * 3 * batch_size)]  # not those of the ends
    assert {counts[number] for number in whole} == {views}
    for step, numbers in enumerate(shown):
        assert len({*numbers}) == batch_size
        assert {number % LANES for number in numbers} == {step % LANES}
        assert [number // LANES % batch_size for number in numbers] == [*range(batch_size)]


def equal(left, right) -> bool:
    return left.keys() == right.keys() and all(torch.equal(left[key], right[key]) for key in left)


def test_a_batch_depends_on_seed_and_number_alone():
    one = photos()
    whole = [one[step] for step in range(40)]
    fresh = photos()
    assert all(equal(fresh[step], whole[step]) for step in (39, 3, 11, 12))
    assert not equal(photos(seed=1)[3], whole[3])
    assert photos()[10**9]["crop"].shape == (6, 3, 40, 40)
    for batch in whole:
        assert batch["degrees"].abs().max() <= 30


def test_loader_processes_do_not_change_the_batches():
    steps = range(20)
    loader = DataLoader(photos(), batch_size=None, sampler=steps, num_workers=2)
    alone = photos()
    assert all(equal(batch, alone[step]) for step, batch in zip(steps, loader, strict=True))


def test_shares_of_a_batch_make_the_whole_and_render_their_own_specimens():
    whole, shares = photos(), [replace(photos(), share=slice(rank, None, 2)) for rank in (0, 1)]
    for step in range(3 * LANES):
        parts = [share[step] for share in shares]
        for key, expected in whole[step].items():
            joined = torch.stack([part[key] for part in parts], dim=1).flatten(0, 1)
            assert torch.equal(joined, expected)
    mine, theirs = ({n for lane in each.waiting.values() for n in lane} for each in shares)
    assert not mine & theirs
    assert len(mine | theirs) == 6 * LANES  # no more waits than is shown


def test_labels_are_those_of_what_is_shown():
    batch = photos()[9]
    numbers = torch.tensor(photos().numbers(9))
    assert torch.equal(batch["crop"][:, 0, 20, 20], (numbers % 251).byte())
    assert torch.equal(batch["label"], numbers % 5)


def test_crops_are_cut_on_every_scale_up_to_that_of_the_photo():
    ramp = np.repeat(np.arange(100, dtype=np.uint8)[None, :, None], 100, axis=0).repeat(3, axis=2)
    views = PhotoViews(Numbered(), 40, 0.0)
    slopes = []
    for seed in range(200):
        crop = views.cut(ramp, np.random.default_rng(seed))["crop"].float()
        assert crop.shape == (3, 40, 40)
        slopes.append(float(crop[0, 0, -1] - crop[0, 0, 0]) / 39)
    assert min(slopes) == pytest.approx(1, abs=0.1)
    assert max(slopes) == pytest.approx(100 / 40, abs=0.1)
    small = PhotoViews(Numbered(), crop_side(224, 180), 180).cut(ramp, np.random.default_rng(0))
    assert small["crop"].shape == (3, 319, 319)


def test_traces_become_normalised_sub_samples():
    features = HapticFeatures(scale="mel", skip_impact=False)
    views = TraceViews(Numbered("haptic"), features, 177)
    batches = GeneratedBatches(views, 5, 2, 0)
    features.fit([batches.specimen(number)[0] for number in range(5)])
    batch = batches[0]
    assert batch["spectrogram"].shape == (5, 1, 50, 177)
    number = batches.numbers(0)[2]
    trace = torch.from_numpy(Numbered("haptic").render(number)[0])
    whole = features(trace)[0, 0].unfold(1, 177, 1)
    assert (whole.transpose(0, 1) == batch["spectrogram"][2, 0]).flatten(1).all(1).any()
