import cv2
import numpy as np
import pytest
import soundfile
import torch

from tex_lightning.errors import UserError
from tex_lightning.senses.features.dft321 import dft321
from tex_lightning.synthetic import SyntheticSpec, make_materials, write_folder, write_tum
from tex_lightning.synthetic.camera import _draw_view
from tex_lightning.synthetic.dataset import listen, photograph, recorded_under
from tex_lightning.synthetic.tool import draw_stroke

TINY = {"recordings": 2, "seconds": 1, "photo_width": 64, "photo_height": 48}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    root = tmp_path_factory.mktemp("folder")
    write_folder(SyntheticSpec(classes=3, **TINY), root)
    return root


def _files(root):
    return {str(p.relative_to(root)): p.read_bytes() for p in root.rglob("*") if p.is_file()}


def test_folder_holds_exactly_the_promised_files(folder):
    names = [material.name for material in make_materials(3, 0)]
    expected = {f"{name}/haptic/{n:02d}.npy" for name in names for n in range(2)}
    expected |= {f"{name}/image/{n:02d}.jpg" for name in names for n in range(2)}
    assert set(_files(folder)) == expected
    trace = np.load(next(folder.rglob("*.npy")))
    assert trace.dtype == np.float32
    assert trace.shape == (3, 10_000)
    assert cv2.imread(str(next(folder.rglob("*.jpg")))).shape == (48, 64, 3)
    for classes in (1, 1000):
        with pytest.raises(UserError, match=f"data.classes is {classes}: choose 2 to 999"):
            SyntheticSpec(classes=classes)


def test_sounds_are_written_only_when_asked_for_and_beside_the_same_files(folder, tmp_path):
    write_folder(SyntheticSpec(classes=2, **TINY), tmp_path, ("haptic", "image", "sound"))
    written, silent = _files(tmp_path), _files(folder)
    sounds = [name for name in written if "/sound/" in name]
    names = [material.name for material in make_materials(2, 0)]
    assert set(sounds) == {f"{name}/sound/{n:02d}.flac" for name in names for n in range(2)}
    assert all(silent[name] == written[name] for name in written if name not in sounds)


def test_sound_files_hold_the_sound_in_16_bits_at_44100_hz(specimen, tmp_path):
    spec = SyntheticSpec(classes=2, **TINY)
    write_folder(spec, tmp_path, ["sound"])
    path = tmp_path / specimen(1).material.name / "sound" / "01.flac"
    assert soundfile.info(path).subtype == "PCM_16"
    sound, rate = soundfile.read(path, dtype="float32")
    assert rate == 44_100
    np.testing.assert_allclose(sound, listen(spec, specimen(1), 1, 1), atol=1 / 32_000)


def test_photos_are_written_as_red_green_blue(folder, specimen):
    expected = photograph(SyntheticSpec(classes=3, **TINY), specimen(0), 0, 1)
    path = folder / specimen(0).material.name / "image" / "01.jpg"
    decoded = cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)
    np.testing.assert_allclose(decoded.mean(axis=(0, 1)), expected.mean(axis=(0, 1)), atol=1)


def test_same_spec_gives_the_same_bytes_and_a_subset_is_unchanged(folder, tmp_path):
    write_folder(SyntheticSpec(classes=2, **TINY), tmp_path)
    larger = _files(folder)
    smaller = _files(tmp_path)
    assert len(smaller) == 8
    assert all(larger[name] == content for name, content in smaller.items())


def test_tum_layout_is_numbered_through_without_class_names(folder, specimen, tmp_path):
    spec = SyntheticSpec(classes=3, **TINY)
    write_tum(spec, tmp_path)
    names = [material.name for material in make_materials(3, 0)]
    expected = {f"Training/Accel/{name}_query{n}.txt" for name in names for n in range(2)}
    expected |= {f"Training/Images/IMG_{5529 + n}.JPG" for n in range(6)}
    written = _files(tmp_path)
    assert set(written) == expected
    # The same photos as in the other layout, in class order.
    for index, name in enumerate(names):
        for n in range(2):
            photo = written[f"Training/Images/IMG_{5529 + 2 * index + n}.JPG"]
            assert photo == (folder / name / "image" / f"{n:02d}.jpg").read_bytes()


def test_tum_traces_are_the_dft321_of_the_folder_traces(folder, tmp_path):
    write_tum(SyntheticSpec(classes=2, **TINY), tmp_path)
    name = make_materials(2, 0)[1].name
    text = np.loadtxt(tmp_path / "Training/Accel" / f"{name}_query1.txt", dtype=np.float32)
    axes = np.load(folder / name / "haptic" / "01.npy")
    np.testing.assert_array_equal(text, dft321(torch.from_numpy(axes)).numpy())
    moving = axes - axes.mean(axis=1, keepdims=True)
    assert np.square(text).sum() == pytest.approx(np.square(moving).sum(), rel=1e-3)


def test_conditions_of_strokes_are_those_of_the_movement():
    spec, said, done = SyntheticSpec(classes=2, recordings=30), [], []
    for number in range(30):
        stroke = draw_stroke(np.random.default_rng([0, 1, number, 0]), 8.0, 1000)
        path = np.linalg.norm(np.diff(stroke.position[:, 1000:], axis=1), axis=0)
        done.append((path.sum() / len(path) * 1000, stroke.force.mean()))
        conditions = recorded_under(spec, "haptic", 1, number)
        said.append((float(conditions["speed"]), float(conditions["force"])))
    for wanted, found in zip(np.transpose(said), np.transpose(done), strict=True):
        assert np.corrcoef(wanted, found)[0, 1] > 0.8
        np.testing.assert_allclose(wanted, found, rtol=0.35)


def test_conditions_of_photos_are_those_of_the_view_and_the_light(specimen):
    spec = SyntheticSpec(classes=2, recordings=6, photo_width=64, photo_height=48)
    warmth: dict[str, list[float]] = {"daylight": [], "ambient": []}
    for number in range(6):
        conditions = recorded_under(spec, "image", 1, number)
        view, _ = _draw_view(np.random.default_rng([0, 1, number, 1]), (64, 48))
        scale = np.sqrt(abs(np.linalg.det(view)))  # tile points for a pixel, tilt aside
        assert abs(float(conditions["distance"]) - scale) < 0.1
        colour = photograph(spec, specimen(1), 1, number).mean((0, 1))
        warmth[conditions["light"]].append(colour[0] / colour[2])
    assert max(warmth["daylight"]) < min(warmth["ambient"])
