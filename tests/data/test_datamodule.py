from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from conftest import ramp

from tex_lightning.data import banks
from tex_lightning.data.banks import InputBank, PhotoBank
from tex_lightning.data.datamodule import SampleSet, SurfaceData, TrainingBatches
from tex_lightning.data.decode import PhotoDecoder, SignalDecoder
from tex_lightning.data.folds import make_samples
from tex_lightning.data.readers.folder import read_folder
from tex_lightning.data.store import Store

TRACES = np.array([2, 0, 1])  # their classes


def batches(surfaces, store, seed=0) -> TrainingBatches:
    some = tuple(f"/{number}" for number in range(4))
    rows = [row for row in read_folder(surfaces).of("image") if row.group.endswith(some)]
    labels = np.array([["alpha", "beta", "gamma"].index(row.label) for row in rows])
    bank = InputBank([ramp(20, 100 * i)[None] for i in range(3)], frames=10)
    photo_bank = PhotoBank(rows, store, 40, 30.0)
    banks = {"haptic": (bank, TRACES), "visual": (photo_bank, labels)}
    return TrainingBatches(banks, 6, seed)


def leaves(batch):
    """The tensors of a batch by the names that lead to them."""
    found = {"label": batch["label"]}
    for sense in batch.keys() - {"label"}:
        found |= {f"{sense}.{name}": value for name, value in batch[sense].items()}
    return found


def test_a_batch_depends_on_seed_and_number_alone(surfaces, photos):
    _, store = photos
    first, again = batches(surfaces, store), batches(surfaces, store)
    for step in (5, 0, 5):
        left, right = first[step], again[step]
        assert left.keys() == {"haptic", "visual", "label"}
        assert leaves(left).keys() == {"haptic.input", "visual.crop", "visual.degrees", "label"}
        assert all(torch.equal(leaves(left)[key], value) for key, value in leaves(right).items())
    crop = first[0]["visual"]["crop"]
    assert not torch.equal(crop, first[1]["visual"]["crop"])
    assert not torch.equal(crop, batches(surfaces, store, seed=1)[0]["visual"]["crop"])


def test_every_photo_comes_once_per_round_with_a_trace_of_its_class(surfaces, photos):
    _, store = photos
    stream = batches(surfaces, store)
    seen = []
    for step in range(2):  # 12 photos in batches of 6
        batch = stream[step]
        seen += batch["label"].tolist()
        trace = (batch["haptic"]["input"][:, 0, 0, 0] // 100).long()
        assert torch.equal(torch.from_numpy(TRACES)[trace], batch["label"])
        assert batch["visual"]["degrees"].abs().max() <= 30
    assert sorted(seen) == [0] * 4 + [1] * 4 + [2] * 4


def test_shares_of_a_batch_make_the_whole(surfaces, photos):
    _, store = photos
    whole = batches(surfaces, store)
    shares = [leaves(replace(whole, share=slice(rank, None, 3))[4]) for rank in range(3)]
    for key, expected in leaves(whole[4]).items():
        joined = torch.stack([share[key] for share in shares], dim=1).flatten(0, 1)
        assert torch.equal(joined, expected)


def test_a_whole_sample_has_the_recordings_of_all_its_modalities(surfaces, tmp_path):
    decoders = {"haptic": SignalDecoder(), "image": PhotoDecoder(half_scale=False)}
    store = Store(tmp_path, decoders)
    samples = make_samples(read_folder(surfaces), ("haptic", "image"))
    whole = SampleSet(samples, store, ["alpha", "beta", "gamma"])
    assert len(whole) == 30
    item = whole[12]
    assert (item["label"], item["recordings"].keys()) == (1, {"haptic", "image"})
    for modality, recording in item["recordings"].items():
        expected = decoders[modality].decode(samples[12].recordings[modality].path).array
        np.testing.assert_array_equal(recording.numpy(), expected)


def test_a_whole_sample_stays_where_it_is_before_the_first_step_too(surfaces, photos):
    """As Lightning validates some by its flag num_sanity_val_steps."""
    data, sample = SurfaceData(batches(surfaces, photos[1]), 2, None, 0), {"recordings": {}}
    data.trainer = SimpleNamespace(validating=False)
    assert data.transfer_batch_to_device(sample, torch.device("cpu"), 0) is sample


def test_batches_that_are_overfitted_are_those_of_the_first_epoch(surfaces, photos):
    data = SurfaceData(batches(surfaces, photos[1]), 2, None, 0)
    strategy = SimpleNamespace(root_device=torch.device("cpu"))
    loop = SimpleNamespace(epoch_progress=SimpleNamespace(current=SimpleNamespace(processed=3)))
    for overfit, numbers in ((0.0, [6, 7]), (1, [0, 1])):
        data.trainer = SimpleNamespace(
            strategy=strategy, global_rank=0, world_size=1, fit_loop=loop, overfit_batches=overfit
        )
        assert [*data.train_dataloader().sampler] == numbers


def test_memory_is_pinned_for_a_gpu_that_is_used(surfaces, photos, monkeypatch):
    """Pinning starts the GPU, which a training on the CPU does not need."""
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(banks, "room", lambda device: 0)
    data = SurfaceData(batches(surfaces, photos[1]), 2, None, 0)
    for kind in ("cpu", "cuda"):
        strategy = SimpleNamespace(root_device=torch.device(kind))
        data.trainer = SimpleNamespace(strategy=strategy, global_rank=0, world_size=1)
        assert data.train_dataloader().pin_memory == (kind == "cuda")


@pytest.mark.parametrize(
    ("room", "workers", "key"), [(1e9, 0, "start"), (9, 0, "input"), (1e9, 1, "input")]
)
def test_a_device_cuts_the_same_from_the_inputs_that_it_holds(
    second_device, surfaces, photos, monkeypatch, room, workers, key
):
    """If it has room for them and no other process makes the batches; only starts go there."""
    monkeypatch.setattr(banks, "room", lambda device: room)
    expected = batches(surfaces, photos[1])
    data = SurfaceData(batches(surfaces, photos[1]), 2, None, workers)
    strategy, progress = SimpleNamespace(root_device=second_device), SimpleNamespace(processed=0)
    data.trainer = SimpleNamespace(
        strategy=strategy, global_rank=0, world_size=1, validating=False,
        fit_loop=SimpleNamespace(epoch_progress=SimpleNamespace(current=progress)),
        overfit_batches=0.0,
    )  # fmt: skip
    for step, batch in enumerate(data.train_dataloader()):
        assert [*batch["haptic"]] == [key]
        moved = leaves(data.transfer_batch_to_device(batch, second_device, 0))
        assert moved.keys() == leaves(expected[step]).keys()
        for name, value in leaves(expected[step]).items():
            assert moved[name].device.type == second_device.type
            assert torch.equal(moved[name].cpu(), value)
    data.teardown("fit")
    assert [*data.batches[0]["haptic"]] == ["input"]
