from dataclasses import replace

import numpy as np
import torch
from conftest import ramp
from scipy import stats

from tex_lightning.data.banks import PhotoBank, SpectrogramBank
from tex_lightning.data.datamodule import EpochSampler, TrainingBatches, _partners
from tex_lightning.data.readers.folder import read_folder
from tex_lightning.perturbations.augment import Augmentation


def batches(surfaces, store, seed=0) -> TrainingBatches:
    rows = [row for row in read_folder(surfaces).of("image") if row.group < 4]
    labels = np.array([["alpha", "beta", "gamma"].index(row.label) for row in rows])
    bank = SpectrogramBank([ramp(20, 100 * i) for i in range(3)], frames=10)
    photo_bank = PhotoBank(rows, store, 40)
    return TrainingBatches((bank, np.array([2, 0, 1])), (photo_bank, labels), 6, 30.0, seed)


def test_a_batch_depends_on_seed_and_number_alone(surfaces, photos):
    _, store = photos
    first, again = batches(surfaces, store), batches(surfaces, store)
    for step in (5, 0, 5):
        left, right = first[step], again[step]
        assert left.keys() == {"spectrogram", "crop", "degrees", "label"}
        assert all(torch.equal(left[key], right[key]) for key in left)
    assert not torch.equal(first[0]["crop"], first[1]["crop"])
    assert not torch.equal(first[0]["crop"], batches(surfaces, store, seed=1)[0]["crop"])


def test_every_photo_comes_once_per_round_with_a_trace_of_its_class(surfaces, photos):
    _, store = photos
    stream = batches(surfaces, store)
    seen = []
    for step in range(2):  # 12 photos in batches of 6
        batch = stream[step]
        seen += batch["label"].tolist()
        trace = (batch["spectrogram"][:, 0, 0, 0] // 100).long()
        assert torch.equal(torch.tensor([2, 0, 1])[trace], batch["label"])
        assert batch["degrees"].abs().max() <= 30
    assert sorted(seen) == [0] * 4 + [1] * 4 + [2] * 4


def test_shares_of_a_batch_make_the_whole(surfaces, photos):
    _, store = photos
    whole = batches(surfaces, store)
    shares = [replace(whole, share=slice(rank, None, 3))[4] for rank in range(3)]
    for key, expected in whole[4].items():
        joined = torch.stack([share[key] for share in shares], dim=1).flatten(0, 1)
        assert torch.equal(joined, expected)


def test_epochs_number_batches_through():
    epoch = 0
    sampler = EpochSampler(3, lambda: epoch)
    assert [*sampler] == [0, 1, 2]
    epoch = 4
    assert [*sampler] == [12, 13, 14]


def test_partners_have_the_label_and_are_drawn_evenly():
    rng = np.random.default_rng(0)
    pool = np.array([2, 0, 1, 0, 2, 0])
    labels = np.repeat([0, 1, 2], 3000)
    drawn = _partners(labels, pool, rng)
    assert np.array_equal(pool[drawn], labels)
    assert stats.chisquare(np.bincount(drawn[:3000], minlength=6)[[1, 3, 5]]).pvalue > 0.01
    assert stats.chisquare(np.bincount(drawn[6000:], minlength=6)[[0, 4]]).pvalue > 0.01


def test_perturbed_crops_keep_their_size_and_place_in_shares(surfaces, photos):
    _, store = photos
    clean = batches(surfaces, store)
    perturbed = batches(surfaces, store)
    names = ["darkness", "scale_down", "scale_up"]
    perturbed.photos[0].augmentation = Augmentation.of(names)
    whole = perturbed[4]
    assert whole["crop"].shape == clean[4]["crop"].shape
    assert (whole["crop"] != clean[4]["crop"]).flatten(1).any(1).all()
    shares = [replace(perturbed, share=slice(rank, None, 3))[4]["crop"] for rank in range(3)]
    assert torch.equal(torch.stack(shares, dim=1).flatten(0, 1), whole["crop"])
