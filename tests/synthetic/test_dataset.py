import cv2
import numpy as np
import pytest
import soundfile

from tex_lightning.errors import UserError
from tex_lightning.synthetic import SyntheticSpec, make_materials, write_folder
from tex_lightning.synthetic.dataset import listen, photograph

TINY = {"recordings": 2, "seconds": 1, "photo_width": 64, "photo_height": 48}


def contents(root):
    return {str(p.relative_to(root)): p.read_bytes() for p in root.rglob("*") if p.is_file()}


def test_files_are_those_of_data_folder_and_depend_on_class_and_seed_alone(tmp_path, specimen):
    spec = SyntheticSpec(classes=2, **TINY)
    write_folder(spec, tmp_path / "two", ("haptic", "image", "sound"))
    write_folder(SyntheticSpec(classes=3, **TINY), tmp_path / "three")
    two, three = contents(tmp_path / "two"), contents(tmp_path / "three")
    names = [material.name for material in make_materials(3, 0)]
    suffixes = {"haptic": "npy", "image": "jpg"}
    assert set(three) == {
        f"{name}/{sense}/{n:02d}.{suffix}"
        for name in names
        for sense, suffix in suffixes.items()
        for n in range(2)
    }
    sounds = {f"{name}/sound/{n:02d}.flac" for name in names[:2] for n in range(2)}
    assert all(three[name] == two[name] for name in {*two} - sounds)
    assert sounds == {name for name in two if "/sound/" in name}
    folder = tmp_path / "two" / names[1]
    trace = np.load(folder / "haptic" / "01.npy")
    assert (trace.dtype, trace.shape) == (np.float32, (3, 10_000))
    sound, rate = soundfile.read(folder / "sound" / "01.flac", dtype="float32")
    assert rate == 44_100
    np.testing.assert_allclose(sound, listen(spec, specimen(1), 1, 1), atol=1 / 32_000)
    photo = cv2.cvtColor(cv2.imread(str(folder / "image" / "01.jpg")), cv2.COLOR_BGR2RGB)
    mean = photograph(spec, specimen(1), 1, 1).mean(axis=(0, 1))
    np.testing.assert_allclose(photo.mean(axis=(0, 1)), mean, atol=1)


@pytest.mark.parametrize("classes", [1, 1000])
def test_the_number_of_classes_is_limited(classes):
    with pytest.raises(UserError, match=f"data.classes is {classes}: choose 2 to 999"):
        SyntheticSpec(classes=classes)
