"""A sense of the user's own: features and a network that nothing is known of."""

import numpy as np
import pytest
import torch
from conftest import make_card
from torch import nn

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.data.decode import SignalDecoder, SourceSignal
from tex_lightning.data.recordings import Recording
from tex_lightning.data.store import Store
from tex_lightning.errors import UserError
from tex_lightning.networks.linear import LinearNet
from tex_lightning.senses.features.proportions import BandProportions
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures
from tex_lightning.senses.signal import SignalSense

RATE = 1000.0
FIT = {"perturb": [], "perturbed_copies": 0, "sensor_augmentation": 0.0}


class Energy(nn.Module):
    """Loudness of frames of 100 samples."""

    def forward(self, signal):
        frames = signal.unfold(-1, 100, 100)
        return frames.square().mean(dim=(0, 2)).sqrt()[None, None]


class Loudness(nn.Module):
    """Loud, medium or quiet, of four frames at a time; it tells nothing of its geometry."""

    def __init__(self):
        super().__init__()
        self.weights = nn.Parameter(torch.tensor([[1.0], [0.0], [-1.0]]))

    def features(self, x, level):
        means = x.unfold(-1, 4, 4).mean(dim=-1)  # (batch, 1, positions)
        return self.weights @ means + torch.tensor([[-0.5], [0.0], [0.5]])


class Bytes(SignalDecoder):
    """Files of unsigned bytes at 500 Hz."""

    def read(self, path, rate=None):
        return SourceSignal(np.frombuffer(path.read_bytes(), np.uint8)[None] / 255, 500.0)


def test_a_format_of_the_user_is_read_by_one_method(tmp_path):
    path, sense = tmp_path / "a.bytes", own()
    path.write_bytes(bytes(np.random.default_rng(0).integers(0, 256, 600, np.uint8)))
    sense.decoder = Bytes(RATE, RATE)
    row, store = Recording("oak", "force", path, 0), Store(tmp_path, {"force": sense.decoder})
    assert not store.fill([row])
    assert (store.rate(row), store.shape(row)) == (500, (1, 1200))
    predicted, _ = sense.decode_input(path, {})
    np.testing.assert_array_equal(predicted, store.load(row))


def own() -> SignalSense:
    return SignalSense("touch", "force", SignalDecoder(RATE, RATE), Energy(), Loudness())


def signal(level: float, samples: int = 1200) -> torch.Tensor:
    return level * torch.ones(1, samples)


def test_it_tells_no_geometry_and_what_needs_one_says_so():
    sense = own()
    assert sense.geometry is None
    assert sense.piece_size(7) == 7
    assert sense.input_size(signal(1.0)) == (1, 12)
    with pytest.raises(UserError, match=r"each see a window .* and Loudness of touch is none"):
        _ = sense.window_size


@pytest.mark.parametrize("samples", [399, 60])
def test_too_short_a_signal_is_refused_in_one_sentence(samples):
    with pytest.raises(UserError) as caught:
        own().positions(signal(1.0, samples), "fc3")
    part = "Loudness" if samples == 399 else "Energy"
    assert str(caught.value).startswith(f"{part} makes nothing of this force recording (")


def test_what_is_not_finite_is_refused():
    broken = signal(1.0)
    broken[0, 5] = torch.nan
    with pytest.raises(UserError, match="The force recording holds NaN"):
        own().positions(broken, "fc3")


def test_a_bank_is_cut_into_training_inputs(tmp_path):
    rows = []
    for number, samples in enumerate((1200, 700)):
        np.save(tmp_path / f"{number}.npy", np.full(samples, 1.0 + number))
        rows.append(Recording("a", "force", tmp_path / f"{number}.npy", number))
    sense = own()
    store = Store(tmp_path, {"force": sense.decoder})
    bank = sense.bank(rows, store, FIT, size=6, seed=0, learn=True)
    pieces = bank.cut(np.array([1, 0, 1]), np.random.default_rng(0))
    x = sense.training_input(pieces, 6)
    assert x.shape == (3, 1, 6)
    assert x[:, 0, 0].tolist() == [2.0, 1.0, 2.0]
    assert sense.network.features(x, "fc3").shape == (3, 3, 1)


class Fitted(Loudness):
    """One that is fitted at once, and takes pieces and what is disturbed."""

    def fit(self, inputs, labels, pieces, disturbed): ...


def test_what_own_features_cannot_take_is_no_piece(tmp_path):
    sense = SignalSense("touch", "force", SignalDecoder(RATE, RATE), Energy(), Fitted())
    rows = []
    for number in range(3):
        path = tmp_path / f"{number}.npy"
        np.save(path, signal(1.0 + number)[0].numpy())
        rows.append(Recording("loud", "force", path, str(number)))
    store = Store(tmp_path, {"force": sense.decoder})
    pieces = sense.bank(rows, store, FIT, size=6, seed=0, learn=True).pieces
    # a quarter is 300 samples, and a sixteenth less than the 100 of a frame
    assert [(number, x.shape) for number, x in pieces] == [(n, (1, 3)) for n in range(3)]


def test_recordings_are_disturbed_as_often_as_they_are_many_of_any_length(tmp_path):
    sense = SignalSense("touch", "force", SignalDecoder(RATE, RATE), Energy(), Fitted())
    rng, lengths = np.random.default_rng(0), [700, 900, 12_000]  # the last is beyond 10 s
    rows = []
    for number, length in enumerate([*lengths, *[800] * 47]):
        path = tmp_path / f"{number}.npy"
        np.save(path, rng.standard_normal(length).astype(np.float32))
        rows.append(Recording("rough", "force", path, str(number)))
    store = Store(tmp_path, {"force": sense.decoder})

    def drawn(count: int, seed: int = 0) -> list:
        return sense.bank(rows[:count], store, FIT, size=6, seed=seed, learn=True).disturbed

    few = drawn(3)
    assert [before.shape[-1] for before, _ in few] == [7] * 3 + [9] * 3 + [100] * 3
    second = Energy()(torch.from_numpy(np.load(rows[1].path))[None])[0]
    for before, _ in few[3:6]:
        torch.testing.assert_close(before, second)
    for before, after in few:
        assert abs(after.shape[-1] - before.shape[-1]) < 15
        assert not torch.equal(before, after)
    torch.testing.assert_close(drawn(3), few)
    assert not torch.equal(drawn(3, seed=1)[0][1], few[0][1])
    assert len(drawn(50)) == 120


def test_spectrograms_are_normalised_by_the_training_set(surfaces, tmp_path):
    sense = SurfaceClassifier(make_card("haptic", width=0.1)).senses["haptic"]
    files = sorted((surfaces / "alpha" / "haptic").iterdir())[:3]
    rows = [Recording("alpha", "haptic", path, place) for place, path in enumerate(files)]
    store = Store(tmp_path, {"haptic": sense.decoder})
    bank = sense.bank(rows, store, FIT, size=192, seed=0, learn=True)
    frames = torch.cat(bank.inputs, dim=-1)[0]
    torch.testing.assert_close(frames.mean(dim=1), torch.zeros(50), atol=1e-3, rtol=0)
    whole = sense(torch.from_numpy(np.array(store.load(rows[2]))))[0]
    torch.testing.assert_close(bank.inputs[2], whole)

    class Own(SpectrogramFeatures):
        def normalise(self, magnitudes):
            return magnitudes

    sense.features = Own(sampling_rate=sense.decoder.sampling_rate)
    sense.bank(rows, store, FIT, size=192, seed=0, learn=True)
    assert not sense.features.known_gain.in_use  # whether a gain matters to it is not known


@pytest.mark.parametrize(("samples", "axes"), [(2000, 1), (10, 1), (2000, 2)])
def test_a_check_refuses_what_band_proportions_would_and_computes_none(monkeypatch, samples, axes):
    features = BandProportions(
        sampling_rate=400, windows=[0.1], bands_per_octave=[3], thresholds=3, fragment_seconds=0.5,
        skip_impact=True, levels=1,
    )  # fmt: skip
    network = LinearNet(3, bands=features.bands, blocks=features.blocks)
    sense = SignalSense("touch", "force", SignalDecoder(400, 400), features, network)
    x = torch.randn(axes, samples, generator=torch.Generator().manual_seed(0))
    if samples > 10 and axes == 1:
        monkeypatch.setattr(features, "describe", None)
        sense.check(x)
        return
    with pytest.raises(UserError) as expected:
        sense.positions(x, "fc3")
    with pytest.raises(UserError) as caught:
        sense.check(x)
    assert str(caught.value) == str(expected.value)


@pytest.mark.parametrize(
    ("share", "normalisation"), [(0.5, "standard"), (0.0, "standard"), (0.5, "paper")]
)
def test_a_share_of_the_training_is_augmented(tmp_path, share, normalisation):
    """The others stay as they are to the bit, and so do spectrograms without a known level."""
    card = make_card("haptic", sampling_rate=RATE, normalisation=normalisation)
    sense = SurfaceClassifier(card).senses["haptic"]
    rng = np.random.default_rng(0)
    np.save(tmp_path / "a.npy", rng.standard_normal((1, 5_000)))
    rows = [Recording("a", "haptic", tmp_path / "a.npy", "0")]
    store = Store(tmp_path, {"haptic": sense.decoder})
    fit = FIT | {"sensor_augmentation": share}
    bank = sense.bank(rows, store, fit, size=200, seed=0, learn=True)
    pieces = bank.cut(np.zeros(64, dtype=int), np.random.default_rng(1))
    inputs = sense.training_input(pieces, 200)
    drawn = pieces.get("changes", torch.zeros(64, 1)).any(dim=1)
    same = (inputs == pieces["input"]).flatten(1).all(dim=1)
    assert torch.equal(same, ~drawn)
    assert drawn.any() == (share > 0 and normalisation == "standard")
