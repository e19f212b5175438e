"""Signals in .npz and .mat as NumPy and SciPy write them, and archives that are refused."""

import h5py
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


TIME = np.arange(300) / 500


@pytest.mark.parametrize("suffix", [".npz", ".mat"])
@pytest.mark.parametrize(
    ("arrays", "axes", "rate", "said"),
    [
        ({"acc": SAMPLES, "t": TIME}, "acc_1 acc_2 acc_3", 500, "times in 't'"),
        (
            {"time_ms": 1000 * TIME, "acc": SAMPLES.T},
            "acc_1 acc_2 acc_3",
            500,
            "times in 'time_ms'",
        ),
        (
            {"ax": SAMPLES[:, 0], "ay": SAMPLES[:, 1], "fs": 800.0},
            "ax ay",
            800,
            "the header of the f",
        ),
        ({"x": SAMPLES[:, 0], "label": np.arange(300) // 299}, "x", None, ""),
    ],
)
def test_arrays_of_one_length_are_columns_of_a_table(tmp_path, suffix, arrays, axes, rate, said):
    samples, hertz, reading = read_samples(save(tmp_path / f"a{suffix}", **arrays))
    assert [*reading.axes] == axes.split()
    np.testing.assert_array_equal(samples, SAMPLES.T[: len(samples)])
    assert hertz == (rate and pytest.approx(rate))
    assert reading.rate_from.startswith(said)
    (chosen,) = read_samples(tmp_path / f"a{suffix}", [axes.split()[-1]]).samples
    np.testing.assert_array_equal(chosen, samples[-1])


def test_a_rate_called_as_one_counts_before_one_that_may_be_of_something_else(tmp_path):
    file = tmp_path / "bearing.mat"  # a shaft turns 25 times a second
    savemat(file, {"bearing": {"sr": 48828, "rate": 25, "load": 270, "gs": SAMPLES}})
    assert read_samples(file).rate == 48828


@pytest.mark.parametrize(
    "given", [{"fs": x} for x in (0.0, -800.0, np.nan, np.inf)] + [{"fs": 800, "sr": 900}]
)
def test_a_rate_that_cannot_be_is_not_known(tmp_path, given):
    samples, rate, _ = read_samples(save(tmp_path / "a.npz", acc=SAMPLES, **given))
    np.testing.assert_array_equal(samples, SAMPLES.T)
    assert rate is None


@pytest.mark.parametrize(
    ("name", "number", "rate"),
    [("dt", 0.0005, 2000), ("Tinterval", 0.002, 500), ("Ts", 1 / 800, 800),
     ("sfreq", 500, 500), ("sample_period", 0.001, 1e3),
     ("sampling_time", 1.6, None), ("ts", 1.7e9, None), ("delta_x", 0.01, None),
     ("dt_ms", 2, 500), ("period_us", 500.0, 2000), ("fs_kHz", 1.344, 1344), ("hz", 500, 500),
     ("dt", 1, None), ("freq", 50, None), ("fs", "2 kHz", 2000), ("fs", "800", 800),
     ("subject", "P01", None), ("note", "once fs=4000", None), ("fs", "", None)],
)  # fmt: skip
@pytest.mark.parametrize("suffix", [".npz", ".mat", ".h5"])
def test_a_number_is_the_rate_or_the_period_by_its_name(tmp_path, suffix, name, number, rate):
    if suffix == ".h5":
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file.create_dataset("acc", data=SAMPLES).attrs[name] = number
    else:
        save(tmp_path / f"a{suffix}", acc=SAMPLES, **{name: number})
    found = read_samples(tmp_path / f"a{suffix}").rate
    assert found == (rate and pytest.approx(rate))


def test_objects_beside_a_signal_are_left_out_and_alone_refused(tmp_path):
    note = np.array({"by": "anna"}, dtype=object)
    signal = read_samples(save(tmp_path / "a.npz", acc=SAMPLES, note=note, fs=800))
    np.testing.assert_array_equal(signal.samples, SAMPLES.T)
    assert signal.rate == 800
    np.save(tmp_path / "b.npy", {"acc": SAMPLES})
    with pytest.raises(UserError, match=r"objects of Python, .* by np.savez\(FILE, x=SAMPLES"):
        read_samples(tmp_path / "b.npy")


def test_arrays_behind_each_other_in_one_file_are_refused(tmp_path):
    with (tmp_path / "a.npy").open("wb") as file:
        np.save(file, SAMPLES)
        np.save(file, SAMPLES)
    with pytest.raises(UserError, match="several arrays; save each into a file of its own"):
        read_samples(tmp_path / "a.npy")


def test_moments_are_times_and_fields_are_columns(tmp_path):
    moments = np.datetime64("2026-11-28T10:00") + np.arange(300) * np.timedelta64(2, "ms")
    signal = read_samples(save(tmp_path / "a.npz", time=moments, acc=SAMPLES))
    assert signal.samples.shape == (3, 300)
    assert signal.rate == pytest.approx(500)
    fields = np.zeros(300, [("t", "f8"), ("x", "f4"), ("y", "i2")])
    fields["t"], fields["x"], fields["y"] = TIME, SAMPLES[:, 0], 100 * SAMPLES[:, 1]
    np.save(tmp_path / "b.npy", fields)
    signal = read_samples(tmp_path / "b.npy")
    assert signal.reading.axes == ("x", "y")
    np.testing.assert_array_equal(signal.samples, [fields["x"], fields["y"]])
    assert signal.rate == pytest.approx(500)


@pytest.mark.parametrize("kind", ["datetime64[ns]", "int64"])
def test_times_of_a_fast_sensor_are_even(tmp_path, kind):
    since = np.int64(1_772_359_200 * 10**9) + np.round(np.arange(300) * 1e9 / 44_100).astype(int)
    signal = read_samples(save(tmp_path / "a.npz", time=since.astype(kind), acc=SAMPLES))
    np.testing.assert_array_equal(signal.samples, SAMPLES.T)
    assert signal.rate == pytest.approx(44_100, rel=1e-5)
    single = read_samples(save(tmp_path / "b.npz", acc=since)).samples
    assert single.dtype == np.float64


def test_fields_of_fields_are_columns_too(tmp_path):
    fields = np.zeros(300, [("t", "f8"), ("imu", [("acc", [("x", "f8"), ("y", "f8")])])])
    fields["t"], fields["imu"]["acc"]["x"], fields["imu"]["acc"]["y"] = TIME, *SAMPLES.T[:2]
    np.save(tmp_path / "a.npy", fields)
    np.savez(tmp_path / "b.npz", data=fields)
    with h5py.File(tmp_path / "c.h5", "w") as file:
        file["data"] = fields
    for name in ("a.npy", "b.npz", "c.h5"):
        samples, rate, reading = read_samples(tmp_path / name)
        np.testing.assert_array_equal(samples, SAMPLES.T[:2])
        assert (rate, reading.axes) == (pytest.approx(500), ("x", "y"))


def test_a_table_of_few_events_beside_a_signal_is_none_of_its_axes(tmp_path):
    events = np.zeros(7, [("onset", "f8"), ("code", "i4")])
    np.savez(
        tmp_path / "a.npz", acc=SAMPLES, events=events, set=np.array([(500.0,)], [("fs", "f8")])
    )
    samples, rate, _ = read_samples(tmp_path / "a.npz")
    np.testing.assert_array_equal(samples, SAMPLES.T)
    assert rate == 500


def test_a_number_counts_before_a_text(tmp_path):
    texts = {"sampling_rate": "4 kHz, resampled"}
    assert read_samples(save(tmp_path / "a.mat", acc=SAMPLES, fs=1000, **texts)).rate == 1000


def test_axes_of_one_array_are_no_recordings_whatever_it_is_called(tmp_path):
    signal = read_samples(save(tmp_path / "a.npz", recording=SAMPLES, t=TIME))
    np.testing.assert_array_equal(signal.samples, SAMPLES.T)


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".mat"])
def test_single_dimensions_count_between_others_alone(tmp_path, suffix):
    file = tmp_path / f"a{suffix}"
    for shape in ((1, 300, 3), (1, 3, 300), (3, 300, 1), (1, 1, 300), (3, 1, 300)):
        array = SAMPLES.T.ravel()[: np.prod(shape)].reshape(shape)
        np.save(file, array) if suffix == ".npy" else save(file, acc=array)
        if shape == (3, 1, 300):
            with pytest.raises(UserError, match="give a file of one recording"):
                read_samples(file)
        else:
            assert read_samples(file).samples.shape in ((3, 300), (1, 300))


@pytest.mark.parametrize("suffix", [".npz", ".mat"])
@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"X": SAMPLES, "y": SAMPLES[:9, 0]}, "it has X .300, 3., y .9,.; keep the signal"),
        ({"name": np.array("oak")}, "no array of numbers"),
        ({"trial_1": SAMPLES, "trial_2": SAMPLES}, "several recordings in 'trial_1_1' to 'trial_2"),
        ({"arr_0": SAMPLES, "arr_1": SAMPLES}, "several recordings in 'arr_0_1' to 'arr_1_3'; wr"),
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


def test_a_struct_is_read_as_if_its_fields_were_variables(tmp_path):
    inner = {"acc": SAMPLES, "t": TIME}
    file = save(tmp_path / "a.mat", data={"imu": inner, "label": "oak"}, calibration=np.eye(3))
    signal = read_samples(file)
    np.testing.assert_array_equal(signal.samples, SAMPLES.T)
    assert signal.rate == pytest.approx(500)
    for _ in range(20):
        inner = {"data": inner}
    np.testing.assert_array_equal(read_samples(save(file, deep=inner)).samples, SAMPLES.T)
    several = np.zeros(2, [("acc", object)])
    several["acc"] = [SAMPLES, SAMPLES]
    with pytest.raises(UserError, match="outside of cells and arrays of structs"):
        read_samples(save(file, trials=several))
    with pytest.raises(UserError, match="several recordings"):
        read_samples(save(file, first={"acc": SAMPLES}, second={"acc": SAMPLES}))


def test_what_inflates_to_more_than_is_read_is_not_loaded(tmp_path, monkeypatch):
    """Sizes in structs are not told before they are read: zeros compress a thousandfold."""
    file = tmp_path / "a.mat"
    savemat(file, {"data": {"signal": np.zeros(2_000_000)}}, do_compression=True)
    assert file.stat().st_size < 20_000
    monkeypatch.setattr("scipy.io.loadmat", lambda *_, **__: pytest.fail("it was loaded"))
    with pytest.raises(ValueError, match="its structs claim more than 100,000 bytes"):
        read_archive(file, 100_000)
