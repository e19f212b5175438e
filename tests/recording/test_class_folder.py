"""A class folder that grows stays one that the readers read."""

import time
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
import soundfile
from conftest import make_photo, make_trace
from PIL import Image

from tex_lightning.core.run_folder import LOCK
from tex_lightning.data.decode import SignalDecoder
from tex_lightning.data.manifest import read_manifest
from tex_lightning.data.readers.folder import read_folder
from tex_lightning.errors import UserError
from tex_lightning.recording import class_folder
from tex_lightning.recording.class_folder import ClassFolder
from tex_lightning.recording.sources import open_camera

SIGNAL = np.stack([make_trace(0, n) for n in range(3)])
SOUND = make_trace(1, 0)[None]
PHOTO = make_photo(0, 0)


def both(root):
    """The table of the folder's reader and that of the manifest, as sets."""
    rows = [
        {(row.label, row.modality, row.path, row.group) for row in table}
        for table in (read_folder(root), read_manifest(root / "manifest.csv"))
    ]
    assert rows[0] == rows[1]
    return rows[0]


def files(root):
    found = (path for path in root.rglob("*") if path.is_file() and path.name != LOCK)
    return sorted(str(path.relative_to(root)) for path in found)


def test_recorders_side_by_side_lose_nothing(tmp_path, monkeypatch):
    """As two sensors on two terminals that end together, which wrote over each other."""
    found = ClassFolder.next_name

    def slow(self):
        name = found(self)
        time.sleep(0.05)
        return name

    monkeypatch.setattr(ClassFolder, "next_name", slow)
    with ThreadPoolExecutor(3) as recorders:
        for _ in range(3):
            folder = ClassFolder(tmp_path, "oak", {})
            recorders.submit(folder.add, {"haptic": (2500, SIGNAL)}, None)
    assert len(both(tmp_path.resolve())) == 3


def test_recordings_of_all_senses_are_numbered_alike_and_read_back(tmp_path):
    root = tmp_path / "new" / "data"
    for label in ("oak", "elm", "oak"):
        ClassFolder(root, label, {}).add(
            {"haptic": (2500, SIGNAL), "sound": (44_100, SOUND)}, PHOTO
        )
    assert files(root) == [
        "elm/haptic/elm_001.wav", "elm/image/elm_001.jpg", "elm/sound/elm_001.wav",
        "manifest.csv",
        "oak/haptic/oak_001.wav", "oak/haptic/oak_002.wav",
        "oak/image/oak_001.jpg", "oak/image/oak_002.jpg",
        "oak/sound/oak_001.wav", "oak/sound/oak_002.wav",
    ]  # fmt: skip
    assert len(both(root.resolve())) == 9
    path = root / "oak" / "haptic" / "oak_002.wav"
    samples, rate = soundfile.read(path, dtype="float32")
    assert soundfile.info(path).subtype == "FLOAT"
    np.testing.assert_array_equal(samples.T, SIGNAL)
    assert rate == 2500
    (row, *_) = [row for row in read_manifest(root / "manifest.csv") if row.path == path.resolve()]
    assert row.sampling_rate == 2500
    SignalDecoder(sampling_rate=2500).decode(path, row.sampling_rate)  # header and manifest agree
    picture = cv2.imread(str(root / "oak" / "image" / "oak_001.jpg"))  # of the same colours
    assert np.abs(picture.astype(int) - PHOTO).mean() < 5


def test_nothing_that_was_there_is_touched(tmp_path):
    folder = tmp_path / "oak" / "Haptics"
    folder.mkdir(parents=True)
    for name in ("a.wav", "oak_007.wav"):
        soundfile.write(folder / name, make_trace(0, 1), 10_000)
    before = {path: path.read_bytes() for path in folder.iterdir()}
    (written,) = ClassFolder(tmp_path, "oak", {}).add({"haptic": (10_000, SIGNAL)}, None)
    assert written.name == "oak_008.wav"
    assert {path: path.read_bytes() for path in before} == before
    groups = {path.name: group for _, _, path, group in both(tmp_path.resolve())}
    assert groups == {"a.wav": "oak/0", "oak_007.wav": "oak/1", "oak_008.wav": "oak/2"}


@pytest.mark.parametrize("broken", ["write_manifest", "_write_jpeg"])
def test_a_recording_is_written_whole_or_not_at_all(tmp_path, monkeypatch, broken):
    folder = ClassFolder(tmp_path, "oak", {})
    folder.add({"haptic": (10_000, SIGNAL)}, PHOTO)
    before = files(tmp_path), (tmp_path / "manifest.csv").read_text()

    def fail(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(class_folder, broken, fail)
    with pytest.raises(KeyboardInterrupt):
        folder.add({"haptic": (10_000, SIGNAL)}, PHOTO)
    assert (files(tmp_path), (tmp_path / "manifest.csv").read_text()) == before


def test_folders_that_cannot_be_added_to(tmp_path):
    (tmp_path / "side" / "oak").mkdir(parents=True)
    soundfile.write(tmp_path / "side" / "oak" / "a.wav", make_trace(0, 1), 10_000)
    with pytest.raises(UserError, match=r"side by side, such as a.wav; move them to .*haptic"):
        ClassFolder(tmp_path / "side", "oak", {})
    with pytest.raises(UserError, match=r"record.conditions: group is a column of its own"):
        ClassFolder(tmp_path, "oak", {"group": 3})
    assert files(tmp_path) == ["side/oak/a.wav"]


@pytest.fixture
def pictures(tmp_path):
    for number in range(2):
        Image.fromarray(make_photo(number, 0)).save(tmp_path / f"p_{number:02d}.png")
    return tmp_path / "p_%02d.png"


def test_pictures_come_one_by_one_until_there_are_no_more(pictures, capfd):
    with open_camera(str(pictures)) as take_photo:
        for number in range(2):
            np.testing.assert_array_equal(take_photo(), make_photo(number, 0))
        with pytest.raises(UserError, match=r"gives no picture .any more.; check the path"):
            take_photo()
    for camera, said in {"93": "cannot be opened; check the path", "front": "names no cam"}.items():
        with pytest.raises(UserError, match=said), open_camera(f"camera:{camera}"):
            pass
    assert capfd.readouterr().err == ""  # OpenCV has its say in words of its own
