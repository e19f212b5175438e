"""Files of tensors that claim more than they hold."""

import zipfile

import numpy as np
import pytest
import torch
from torch import nn

from tex_lightning.networks import archives
from tex_lightning.networks.archives import SizeLimit, check_archive, check_weights


def test_an_archive_that_would_become_too_large_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(archives, "MAX_BYTES", 1 << 20)
    path = tmp_path / "a.npz"
    np.savez_compressed(path, zeros=np.zeros(1 << 18))
    with pytest.raises(ValueError, match="more memory than any network"):
        check_archive(path)
    torch.save({"weight": torch.zeros(1 << 19)}, path)  # as large, and not compressed
    check_archive(path)
    path.write_bytes(b"no archive")
    check_archive(path)
    assert not zipfile.is_zipfile(path)


def test_a_network_larger_than_its_file_is_not_made():
    with SizeLimit(200):
        layer = nn.Conv1d(10, 10, 1)
    assert layer.weight.shape == (10, 10, 1)
    with pytest.raises(ValueError, match="more weights than the file"), SizeLimit(10**6):
        nn.Linear(10**9, 10**9)


@pytest.mark.parametrize(
    ("make", "arguments"),
    [
        (torch.arange, {"end": 7}),
        (torch.arange, {"start": 2, "end": 7.5}),
        (torch.arange, {"start": 7, "end": 2, "step": -2}),
        (torch.eye, {"n": 3}),
        (torch.eye, {"n": 3, "m": 4}),
        (torch.hann_window, {"window_length": 9}),
        (torch.linspace, {"start": 0, "end": 1, "steps": 5}),
    ],
)
def test_lengths_are_counted_as_pytorch_makes_them(make, arguments):
    for values, named in [((), arguments), (arguments.values(), {})]:
        with SizeLimit(1) as limit:
            before = limit.left
            made = make(*values, **named)
            assert before - limit.left == made.numel()


@pytest.mark.parametrize("value", [torch.nan, torch.inf, -1e30, 1j])
def test_weights_that_no_training_gives_are_named(value):
    check_weights({"a": torch.ones(3), "b": torch.tensor(5)})
    with pytest.raises(ValueError, match=r"a\.weight holds NaN or huge numbers"):
        check_weights({"a.weight": torch.tensor([0, value])})
