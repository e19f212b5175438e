from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch
from conftest import ramp
from PIL import Image
from scipy import stats

from tex_lightning.data import banks
from tex_lightning.data.banks import InputBank, PhotoBank
from tex_lightning.perturbations.table import Augmentation

FIRST = np.array([0]), np.random.default_rng(0)


def spectrogram(frames, start):
    """One channel whose columns are numbered."""
    return ramp(frames, start)[None]


def test_sub_samples_are_contiguous_pieces_of_their_own_spectrogram():
    bank = InputBank([spectrogram(20, 0), spectrogram(35, 100), spectrogram(11, 200)], frames=10)
    indices = np.array([0, 1, 2, 1] * 50)
    cut = bank.cut(indices, np.random.default_rng(0))["input"]
    assert cut.shape == (200, 1, 3, 10)
    assert cut[:, 0, 0].diff().eq(1).all()
    starts = cut[:, 0, 0, 0].numpy()
    assert {*starts[indices == 0]} == set(range(11))
    assert {*starts[indices == 2]} == {200, 201}
    assert (starts[indices == 1] >= 100).all()
    assert (starts[indices == 1] <= 125).all()


def test_a_bank_tells_whether_its_inputs_are_those_it_was_given():
    short, long = spectrogram(8, 0), spectrogram(20, 100)
    assert InputBank([long, long], frames=10).as_given
    bank = InputBank([short, long], frames=10)
    assert not bank.as_given
    assert [x.shape[-1] for x in bank.inputs] == [16, 20]


def test_every_version_of_a_recording_is_cut_alike():
    versions = [spectrogram(20, 100 * number) for number in range(6)]  # of two recordings, three
    bank = InputBank(versions, frames=10, versions=3)
    cut = bank.cut(np.repeat([0, 1], 3000), np.random.default_rng(0))["input"]
    number = (cut[:, 0, 0, 0] // 100).long().numpy()
    assert {*number[:3000]} == {0, 2, 4}
    assert {*number[3000:]} == {1, 3, 5}
    assert stats.chisquare(np.bincount(number[:3000])[::2]).pvalue > 0.01


def test_crops_are_pieces_of_the_photo(photos):
    rows, store = photos
    bank = PhotoBank(rows, store, side=230, rotation=0.0)
    crop = bank.cut(np.array([3]), np.random.default_rng(1))["crop"][0]
    photo = torch.from_numpy(np.array(store.load(rows[3]))).permute(2, 0, 1)
    places = [
        (top, left)
        for top in range(11)
        for left in range(11)
        if torch.equal(photo[:, top : top + 230, left : left + 230], crop)
    ]
    assert len(places) == 1


@pytest.mark.parametrize("side", [30, 230, 500])
def test_a_device_that_holds_photos_cuts_the_same_crops(photos, second_device, tmp_path, side):
    """Photos of several sizes; places and angles are all that is sent there."""
    (row, *others), store = photos
    small = replace(row, path=tmp_path / "small.png")
    Image.open(row.path).crop((0, 0, 57, 41)).save(small.path)
    bank = PhotoBank([others[0], small, others[1]], store, side, 30.0)
    cut = partial(bank.cut, np.array([2, 1, 0, 1, 0]), share=slice(1, None))
    near = cut(np.random.default_rng(0))
    bank.hold(second_device)
    far = cut(np.random.default_rng(0))
    assert {key: x.shape for key, x in far.items()} == {"place": (4, 5), "degrees": (4,)}
    found = bank.cut_there({key: x.to(second_device) for key, x in far.items()})
    assert torch.equal(found["crop"].cpu(), near["crop"])
    assert torch.equal(found["degrees"].cpu(), near["degrees"])


def test_photos_that_do_not_fit_or_are_perturbed_are_not_held(photos, second_device, monkeypatch):
    rows, store = photos
    pixels = sum(store.load(row).nbytes for row in rows)
    for room, names, held in (
        (pixels, (), True),
        (pixels - 1, (), False),
        (pixels, ("jpeg",), False),
    ):
        monkeypatch.setattr(banks, "room", lambda _, room=room: room)
        bank = PhotoBank(rows, store, 20, 0.0, Augmentation.of(names))
        bank.hold(second_device)
        assert (bank.held is not None) == held
        assert ("place" if held else "crop") in bank.cut(*FIRST)


def test_photos_too_small_are_mirrored_without_black(photos):
    rows, store = photos
    bank = PhotoBank(rows, store, side=500, rotation=0.0)
    crop = bank.cut(np.array([0]), np.random.default_rng(1))["crop"][0]
    assert crop.shape == (3, 500, 500)
    assert torch.equal(crop[:, :240, :240], crop[:, :240, 240:480].flip(2))
    assert crop.float().mean() == pytest.approx(128, abs=10)


def test_inputs_shorter_than_a_sub_sample_are_repeated():
    inputs = [torch.rand(1, 3, length) for length in (20, 7)]
    whole, repeated = InputBank(iter(inputs), 10).inputs
    assert torch.equal(whole, inputs[0])
    assert torch.equal(repeated, inputs[1].repeat(1, 1, 2))


def test_few_photos_stay_open_whatever_their_number(photos, monkeypatch):
    rows, store = photos
    expected = PhotoBank(rows, store, 20, 0.0).cut(np.arange(6), np.random.default_rng(0))["crop"]
    monkeypatch.setattr(banks, "MAX_MAPS", 2)
    bank = PhotoBank(rows, store, 20, 0.0)
    assert torch.equal(bank.cut(np.arange(6), np.random.default_rng(0))["crop"], expected)
    assert len(bank.maps) <= 2  # each holds a file open
