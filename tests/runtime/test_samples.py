"""Samples in arrays: which shapes and values are taken."""

import numpy as np
import pytest
import torch

from tex_lightning_runtime.errors import UserError
from tex_lightning_runtime.samples import as_trace, check_samples, choose_channels

AXES = np.random.default_rng(0).standard_normal((3, 700))


@pytest.mark.parametrize("dtype", [torch.float64, torch.bfloat16, torch.int16])
def test_a_tensor_is_taken_as_its_numbers_are(dtype):
    tensor = (1000 * torch.from_numpy(AXES)).to(dtype).requires_grad_(dtype.is_floating_point)
    found = as_trace(tensor.T)
    np.testing.assert_array_equal(found, tensor.detach().double().numpy())
    assert found.dtype == np.float64


@pytest.mark.parametrize("spoil", [lambda x: x.to("meta"), torch.Tensor.to_sparse])
def test_a_tensor_without_plain_values_is_told(spoil):
    with pytest.raises(UserError, match=r"^it cannot be read as an array \(.+\); give one\.$"):
        as_trace(spoil(torch.from_numpy(AXES)), "it")


def test_the_longer_dimension_is_time_unless_it_is_a_chunk():
    assert as_trace(AXES.T).shape == as_trace(AXES).shape == (3, 700)
    assert as_trace(AXES[:, :2], is_chunk=True).shape == (3, 2)
    assert as_trace(AXES[:, :2]).shape == (2, 3)
    assert as_trace(AXES[0, :1], is_chunk=True).shape == (1, 1)
    for wrong in (np.zeros((65, 66)), np.zeros((2, 3, 4)), np.zeros((3, 0)), np.zeros(())):
        with pytest.raises(UserError, match=r"^it has the shape .*with 1 to 64 axes"):
            as_trace(wrong, "it")
    with pytest.raises(UserError, match=r"^it has the shape"):
        as_trace(np.zeros((65, 1)), "it", is_chunk=True)
    with pytest.raises(UserError, match=r"^it cannot be read as an array \([^.]*\); give one\.$"):
        as_trace([[1, 2], [3]], "it")


def test_names_stand_for_as_many_axes_without_names():
    np.testing.assert_array_equal(choose_channels(AXES, ["x", "y", "z"], "it"), AXES)
    np.testing.assert_array_equal(choose_channels(AXES, [2, 0], "it"), AXES[[2, 0]])
    with pytest.raises(UserError, match=r"it has 3 channels without names, and data\.channels"):
        choose_channels(AXES, ["x", "y"], "it")


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e9])
def test_the_place_of_a_number_that_is_none_is_told(value):
    wrong = AXES.copy()
    wrong[1, 20] = value
    with pytest.raises(UserError, match=r"number beyond 1e.09 at sample 120; repair"):
        check_samples(wrong, "It", 100)
