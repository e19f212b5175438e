"""Every perturbation on its scale, against what its unit means."""

from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest
from conftest import make_photo, make_trace
from scipy.signal import resample_poly

from tex_lightning.errors import UserError
from tex_lightning.perturbations.pixels import Scene
from tex_lightning.perturbations.table import (
    SEVERITIES,
    Augmentation,
    Perturbation,
    perturbations,
    read_severities,
    trainable,
)

RATE = 10_000.0
TABLE = perturbations()
# shapes change, or chance decides about whole recordings: a distance says nothing of these
RESHAPED = {"wrong_rate", "stroke_velocity", "impact_left_in", "shorter_trace",
            "scale_up", "scale_down"}  # fmt: skip
# what has turned further is not more different
TURNED = {"rotation", "nearer"}
STRIPED = {"defocus_blur", "motion_blur"}  # these may turn stripes round


def trace(axes: int = 1) -> np.ndarray:
    return np.stack([make_trace(axis, 0) for axis in range(axes)])


def sound() -> np.ndarray:
    """A tone in noise, brought to the rate of sounds."""
    return resample_poly(trace(), 441, 100, axis=1).astype(np.float32)


def recording(perturbation) -> np.ndarray:
    if perturbation.modality == "image":
        return make_photo(0, 0)
    return sound() if perturbation.modality == "sound" else trace()


def scene(seed: int = 0) -> Scene:
    return Scene(np.random.default_rng(seed), RATE)


def power(samples: np.ndarray) -> float:
    return float(((samples - samples.mean()) ** 2).mean())


@pytest.mark.parametrize("perturbation", TABLE.values(), ids=lambda each: each.name)
def test_recordings_keep_their_type_and_the_original_is_left_alone(perturbation):
    clean = recording(perturbation)
    before = clean.copy()
    assert perturbation.apply(clean, 0, scene()) is clean
    for severity in (0.3, *SEVERITIES):
        harmed = perturbation.apply(clean, severity, scene())
        assert harmed.dtype == clean.dtype
        assert harmed.ndim == clean.ndim
        assert harmed.flags.c_contiguous
        assert np.isfinite(harmed).all()
    assert np.array_equal(clean, before)


@pytest.mark.parametrize(
    "perturbation",
    [each for each in TABLE.values() if each.name not in RESHAPED | TURNED],
    ids=lambda each: each.name,
)
def test_severer_is_further_from_the_original(perturbation):
    clean = recording(perturbation)
    if perturbation.modality == "image":  # not grey, or colours could not be lost
        clean = (clean * np.array([1.0, 0.7, 0.4])).astype(np.uint8)
    if perturbation.name in STRIPED:
        clean = np.random.default_rng(0).integers(0, 256, clean.shape).astype(np.uint8)
        clean = cv2.GaussianBlur(clean, (0, 0), 3)
    gaps = [
        np.abs(perturbation.apply(clean, severity, scene()).astype(float) - clean).mean()
        for severity in SEVERITIES
    ]
    assert all(left <= right * 1.03 for left, right in pairwise(gaps)), gaps
    assert gaps[-1] > gaps[0]


@pytest.mark.parametrize("name", ["white_noise", "mains_hum"])
@pytest.mark.parametrize("severity", [0.5, 1, 3, 5])
def test_noise_has_the_stated_ratio_to_the_signal(name, severity):
    clean = trace().astype(np.float64)
    harmed = TABLE[name].apply(clean, severity, scene())
    ratio = 10 * np.log10(power(clean) / power(harmed - clean))
    assert ratio == pytest.approx(TABLE[name].value(severity), abs=0.1)


@pytest.mark.parametrize("severity", SEVERITIES)
def test_shares_are_shares(severity):
    clean = np.random.default_rng(0).standard_normal((1, 50_000)).astype(np.float32)
    for name in ("clipping", "dropped_stretch"):
        changed = (TABLE[name].apply(clean, severity, scene()) != clean).mean()
        assert changed == pytest.approx(TABLE[name].value(severity), abs=0.005)
    photo = np.random.default_rng(0).integers(1, 255, (300, 300, 3)).astype(np.uint8)
    changed = (TABLE["impulse_noise"].apply(photo, severity, scene()) != photo).mean()
    assert changed == pytest.approx(TABLE["impulse_noise"].value(severity), rel=0.1)


def test_a_wrong_rate_lowers_a_tone_and_a_faster_stroke_raises_it():
    time = np.arange(20_000) / RATE
    tone = np.sin(2 * np.pi * 400 * time)[None].astype(np.float32)
    for name, factor in (("wrong_rate", 1 / 1.4), ("stroke_velocity", 2.0)):
        changed = TABLE[name].apply(tone, 5, scene())[0]
        frequency = np.abs(np.fft.rfft(changed)).argmax() * RATE / len(changed)
        assert frequency == pytest.approx(400 * factor, rel=0.01)
        assert len(changed) == pytest.approx(20_000 / factor, rel=0.01)


def test_a_quantised_ramp_has_as_many_values_as_the_bits_allow():
    ramp = np.linspace(-1, 1, 10_001)[None]
    bits = round(TABLE["quantisation"].value(3))
    values = np.unique(TABLE["quantisation"].apply(ramp, 3, scene()).round(6))
    assert len(values) == 2**bits
    np.testing.assert_allclose(values[[0, -1]], [-1, 1], atol=1e-6)


@pytest.mark.parametrize(("hz", "gain"), [(200, 6), (2000, 3)])
def test_a_heavier_hand_is_louder_by_decibels_and_darker_by_half_as_many_a_decade(hz, gain):
    tone = np.sin(2 * np.pi * hz / RATE * np.arange(int(RATE)))[None]
    louder = TABLE["force"].apply(tone, 2, scene())  # 6 dB
    assert 10 * np.log10(power(louder) / power(tone)) == pytest.approx(gain, abs=0.05)


def test_photos_change_size_as_stated():
    photo = make_photo(0, 0)
    assert TABLE["scale_down"].apply(photo, 5, scene()).shape == (120, 120, 3)
    assert TABLE["scale_up"].apply(photo, 5, scene()).shape == (480, 480, 3)
    halved = TABLE["scale_down"].apply(photo, 5, scene())
    exact = photo.reshape(120, 2, 120, 2, 3).mean(axis=(1, 3))
    assert np.abs(halved - exact).max() <= 1


def test_gaussian_noise_and_blur_have_the_stated_deviation():
    grey = np.full((200, 200, 3), 128, np.uint8)
    noisy = TABLE["gaussian_noise"].apply(grey, 1, scene())
    assert noisy.std() / 255 == pytest.approx(0.08, rel=0.03)
    point = np.zeros((101, 101, 3), np.uint8)
    point[50, 50] = 255
    blurred = TABLE["gaussian_blur"].apply(point, 1, scene())[..., 0].astype(float)
    places = np.arange(101) - 50
    variance = (blurred.sum(axis=0) * places**2).sum() / blurred.sum()
    assert np.sqrt(variance) == pytest.approx(1, rel=0.1)


def own(tmp_path, text: str) -> dict:
    path = tmp_path / "own.yaml"
    path.write_text(text)
    return read_severities(path)


LEVELS = "unit: a, levels: [0, 1, 2, 3, 4, 5]"


def test_a_users_table_names_any_modality(tmp_path):
    found = own(
        tmp_path,
        f"force: {{weaker: {{function: quieter, {LEVELS}}}}}\n"
        f"thermal: {{hot: {{function: tex_lightning.perturbations.pixels.darkness, {LEVELS}}}}}\n",
    )
    assert [each.modality for each in found.values()] == ["force", "thermal"]
    weaker = found["weaker"].apply(trace(), 2, scene())
    assert weaker == pytest.approx(trace() / 10**0.1)
    assert weaker.dtype == np.float32
    photo = make_photo(0, 0)
    assert np.array_equal(found["hot"].apply(photo, 1, scene()), photo)
    assert found["hot"].apply(photo, 0.5, scene()).dtype == np.uint8


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"image: {{jpeg: {{function: darkness, {LEVELS}}}}}", "jpeg is the name of one"),
        (f"force: {{weak: {{function: weaker, {LEVELS}}}}}", "which is no function of the package"),
        (f"force: {{weak: {{function: math.pi, {LEVELS}}}}}", "math.pi, which is no function;"),
        (f"force: {{weak: {{{LEVELS}}}}}", "names weak, which is no function of the package"),
        (f"a: {{x: {{function: force, {LEVELS}}}}}\nb: {{x: {{function: force, {LEVELS}}}}}",
         "x is there twice"),
        ("a: {x: {function: darkness, unit: a, levles: [0]}}", "keyword argument 'levles'"),
        ("a: {x: {function: darkness, unit: a}}", "x has no six levels"),
    ],
)  # fmt: skip
def test_a_users_table_is_refused_in_one_sentence(tmp_path, text, said):
    with pytest.raises(UserError, match=said):
        own(tmp_path, text)


def loses_an_axis(recording, value, scene):
    return recording[0]


def gives_nan(recording, value, scene):
    return recording * np.float32("nan")


def of_a_user(name: str, modality: str) -> Perturbation:
    return Perturbation("mine", modality, "a", (0, 1, 2, 3, 4, 5), function=f"{__name__}.{name}")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("loses_an_axis", "returned a ndarray of "),
        ("gives_nan", "gave NaN or infinity"),
    ],
)
def test_a_users_function_that_makes_no_recording_is_named(name, said):
    own = of_a_user(name, "force")
    line = rf"^mine of force in stability.severities \({name}\) {said}.*; a perturbation takes"
    with pytest.raises(UserError, match=line):
        own.apply(trace(3), 3, scene())


def test_what_is_held_out_cannot_be_trained_on():
    names = {*trainable("haptic"), *trainable("image"), *trainable("sound")}
    assert {"white_noise", "jpeg", "sound_low_pass"} <= names
    assert trainable("thermal") == ()
    left = [kind for name, kind in perturbations().items() if name not in names]
    assert all(kind.held_out for kind in left)


@pytest.mark.parametrize("modality", ["haptic", "image", "sound"])
def test_all_that_may_be_trained_on_needs_the_recording_alone(modality):
    for name in trainable(modality):
        augmentation, clean = Augmentation.of([name], rate=RATE), recording(TABLE[name])
        changed, again = (augmentation(clean, np.random.default_rng(2)) for _ in range(2))
        assert (changed.dtype, changed.ndim) == (clean.dtype, clean.ndim)
        assert np.array_equal(changed, again)


def test_a_share_is_changed_by_every_kind_alike():
    augmentation, photo = (
        Augmentation.of(["darkness", "scale_down"], share=0.5),
        make_photo(0, 0, 60),
    )
    changed = [augmentation(photo, np.random.default_rng(seed)) for seed in range(400)]
    smaller = sum(each.shape != photo.shape for each in changed)
    darker = sum(each.shape == photo.shape and each is not photo for each in changed)
    assert 70 < smaller < 130
    assert 70 < darker < 130
    never = replace(augmentation, share=0.0)
    assert never(photo, np.random.default_rng(0)) is photo
