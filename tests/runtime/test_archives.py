"""Signals in .npz and .mat as NumPy and SciPy write them, and archives that are refused."""

import numpy as np
import pytest
from scipy.io import savemat

from tex_lightning.errors import UserError
from tex_lightning_runtime.archives import read_archive
from tex_lightning_runtime.traces import read_samples

SAMPLES = np.random.default_rng(0).standard_normal((300, 3))


def save(path, **arrays):
    np.savez(path, **arrays) if path.suffix == ".npz" else savemat(path, arrays)
    return path


@pytest.mark.parametrize("suffix", [".npz", ".mat"])
def test_the_only_array_is_the_signal_and_a_number_its_rate(tmp_path, suffix):
    file = save(tmp_path / f"a{suffix}", acc=SAMPLES, fs=1000.0, subject=7)
    signal = read_samples(file)
    np.testing.assert_array_equal(signal.samples, SAMPLES.T)
    assert signal.rate == 1000
    assert read_samples(save(tmp_path / f"b{suffix}", x=SAMPLES[:, 0])).rate is None


@pytest.mark.parametrize("suffix", [".npz", ".mat"])
@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"a": SAMPLES, "b": SAMPLES}, "the arrays a, b"),
        ({"name": np.array("oak")}, "no array of numbers"),
        ({"a": np.zeros((3, 200, 70))}, "samples of 1 to 64"),
    ],
)
def test_what_is_no_single_signal_is_refused(tmp_path, suffix, arrays, said):
    with pytest.raises(UserError, match=said):
        read_samples(save(tmp_path / f"a{suffix}", **arrays))


def test_hostile_and_damaged_archives_are_refused(tmp_path):
    pickled = tmp_path / "a.npz"
    np.savez(pickled, a=np.array([{"b": 1}], dtype=object))
    with pytest.raises(UserError, match="pickled objects, which may run code"):
        read_samples(pickled)
    for suffix in (".npz", ".mat"):
        file = save(tmp_path / f"b{suffix}", a=SAMPLES)
        with pytest.raises(ValueError, match="claims"):
            read_archive(file, 50)
        file.write_bytes(file.read_bytes()[:700])
        with pytest.raises(UserError, match="no whole"):
            read_samples(file)


def test_what_is_inside_of_structs_is_not_loaded(tmp_path, monkeypatch):
    """Their sizes are not told before they are read: zeros compress a thousandfold."""
    inner = {"signal": np.zeros(2_000_000)}
    file = tmp_path / "a.mat"
    savemat(file, {"data": inner, "acc": SAMPLES}, do_compression=True)
    samples, _ = read_archive(file, 2000)
    np.testing.assert_array_equal(samples, SAMPLES)
    savemat(file, {"data": inner}, do_compression=True)
    monkeypatch.setattr("scipy.io.loadmat", lambda *_, **__: pytest.fail("it was loaded"))
    with pytest.raises(ValueError, match="only structs or cells"):
        read_archive(file, 2000)
