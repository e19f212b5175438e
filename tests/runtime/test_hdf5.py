"""HDF5 as h5py writes it, with MATLAB's header and classes too, and what is refused."""

import sys

import h5py
import numpy as np
import pytest

from tex_lightning.errors import UserError
from tex_lightning_runtime.archives import read_archive
from tex_lightning_runtime.traces import read_samples

SAMPLES = np.random.default_rng(0).standard_normal((300, 3))
TIME = np.arange(300) / 500


def plain(file):
    file["acc"] = SAMPLES
    file["fs"] = [[500.0]]


def compressed(file):
    """In pieces, beside what is no signal; the rate is an attribute."""
    how = {"compression": "gzip", "shuffle": True, "fletcher32": True, "chunks": (64, 2)}
    file.create_dataset("imu/acc", data=SAMPLES, **how).attrs["Sampling Rate"] = 500
    file["imu/contact"] = np.ones(300, dtype=bool)
    file["calibration"] = np.eye(3)
    file["label"], file["names"] = "oak", np.array(["x", "y", "z"], h5py.string_dtype())
    file["pointer"], file["nowhere"] = file["label"].ref, h5py.SoftLink("/there")
    file.attrs["subject"] = 3


def times(file):
    file["imu/t"], file["imu/acc"] = TIME, SAMPLES.T.astype(">f4")


def a_rate_in_an_array(file):
    file["acc"] = SAMPLES
    file.attrs["fs"], file.attrs["scales"] = [500], [1.0, 2.0]


def fields(file):
    rows = np.zeros(300, [("time_ms", "f8"), ("x", "f4"), ("y", "f4"), ("z", "f4")])
    rows["time_ms"] = 1000 * TIME
    rows["x"], rows["y"], rows["z"] = SAMPLES.T
    file["rows"] = rows


def of_matlab(file):
    """A struct is a group; its text are numbers of a class of their own."""
    for name, value, kind in (
        ("data/acc", SAMPLES.T, "double"),
        ("data/fs", [[500.0]], "double"),
        ("data/label", np.array([[111, 97, 107]], "u2"), "char"),
        ("data/contact", np.ones((1, 300), "u1"), "logical"),
    ):
        file[name] = value
        file[name].attrs["MATLAB_class"] = np.bytes_(kind)
    file["none"] = np.zeros(2, "u8")
    file["none"].attrs["MATLAB_empty"] = np.uint8(1)
    file["#refs#/a"] = SAMPLES[:200]


def write(path, fill, **how):
    with h5py.File(path, "w", **how) as file:
        fill(file)
    return path


@pytest.mark.parametrize("fill", [plain, compressed, times, fields, of_matlab, a_rate_in_an_array])
@pytest.mark.parametrize(("suffix", "header"), [(".h5", 0), (".hdf5", 1024), (".mat", 512)])
def test_arrays_are_those_that_h5py_wrote(tmp_path, fill, suffix, header):
    signal = read_samples(write(tmp_path / f"a{suffix}", fill, userblock_size=header))
    np.testing.assert_allclose(signal.samples, SAMPLES.T, rtol=1e-6)
    assert signal.rate == pytest.approx(500)


def test_arrays_are_in_the_order_of_their_names(tmp_path):
    def fill(file):
        for name in ("z", "x", "y", "ch10", "ch2"):
            file[name] = SAMPLES[:, 0]

    names = read_samples(write(tmp_path / "a.h5", fill)).reading.axes
    assert names == ("ch2", "ch10", "x", "y", "z")


def several(file):
    file["first/acc"], file["second/acc"] = SAMPLES, SAMPLES


def circle(file):
    file["acc"], file["again"] = SAMPLES, file["/"]


def table_of_pandas(file):
    file["table/values"] = SAMPLES
    file["table"].attrs["pandas_type"] = "frame"


@pytest.mark.parametrize(
    ("fill", "said"),
    [
        (several, "several recordings .first/acc, second/acc.; write each to a file of its own"),
        (circle, "a group that holds itself"),
        (table_of_pandas, "a table of pandas; save it by its to_csv"),
        (lambda file: file.create_dataset("a", (1 << 40,), "f4", chunks=(9,)), "it claims 1,099,"),
        (lambda file: file.create_dataset("a", data=h5py.Empty("f4")), "does not read .*save it a"),
        (lambda file: file.create_dataset("name", data="oak"), "no array of numbers"),
    ],
)
def test_what_is_no_signal_is_refused(tmp_path, monkeypatch, fill, said):
    monkeypatch.setattr("tex_lightning_runtime.hdf5.MAX_PARTS", 9)
    with pytest.raises(UserError, match=said):
        read_samples(write(tmp_path / "a.h5", fill))


def said_of(file, content):
    """What is wrong with a file of this content, nothing if it is read."""
    file.write_bytes(content)
    try:
        read_archive(file, 1 << 20)
    except ValueError as error:
        return str(error)
    return ""


def test_every_cut_is_seen_and_no_damage_ends_otherwise_than_in_a_sentence(tmp_path):
    whole = write(tmp_path / "a.h5", compressed).read_bytes()
    rng, file = np.random.default_rng(0), tmp_path / "b.h5"
    for size in rng.integers(1, len(whole), 40):
        assert said_of(file, whole[:size]) in ("it is cut off", "it is no HDF5")
    for _ in range(100):
        damaged = bytearray(whole)
        for place in rng.integers(0, 6000, 4):
            damaged[place] = rng.choice([0, 1, 255])
        assert said_of(file, damaged)[:3] in ("", "it ")


def test_what_is_not_installed_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyfive", None)
    with pytest.raises(UserError, match="takes pyfive: pip install pyfive"):
        read_samples(write(tmp_path / "a.h5", plain))
