"""Label maps have the colours of their labels, where the fragments lie."""

import base64
import io
import json

import numpy as np
import pytest
import soundfile
from matplotlib.colors import to_rgb
from PIL import Image

from tex_lightning.evaluation.outcomes import Outcome, write_outcomes
from tex_lightning.inference.evidence import PhotoEvidence, SignalEvidence, equal_parts
from tex_lightning.report.page_media import (
    LEGEND,
    SIDE,
    map_folder,
    shown_samples,
    write_map,
)

CLASSES = ["alpha", "beta", "gamma", "delta"]
BLUE, RED, YELLOW = (255 * np.array(to_rgb(colour)) for colour in LEGEND.values())


def scores(labels: np.ndarray) -> np.ndarray:
    return 2.0 * (np.arange(len(CLASSES))[:, None, None] == labels)


def signal(labels: list[int], columns: np.ndarray, seconds: float, rate: float) -> SignalEvidence:
    samples = np.zeros((1, int(seconds * rate)), np.float32)
    nothing = np.empty(0)
    return SignalEvidence(
        "haptic", scores(np.array([labels])), np.array([[0.0, 1.0]]), columns, 1.0,
        samples, rate, columns[0, 0], None, nothing, nothing,
    )  # fmt: skip


def pixels(path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image).astype(float)


def outcome(file, rate: float = 10_000) -> Outcome:
    rates = json.dumps({"haptic": rate})
    return Outcome({"haptic": str(file)}, "alpha", "beta", 1.0, 1, 0, 1.0, rates=rates)


def raw(content: str) -> io.BytesIO:
    return io.BytesIO(base64.b64decode(content.partition(",")[2]))


def opened(content: str) -> np.ndarray:
    with Image.open(raw(content)) as image:
        return np.asarray(image).astype(float)


def test_a_photo_has_the_colours_of_its_fragments_and_is_grey_elsewhere(tmp_path):
    labels = np.array([[0, 1], [2, 3]])
    rows, columns = equal_parts(2, 0, 400), equal_parts(2, 0, 600)
    photo = np.full((500, 600, 3), (0, 200, 0), np.uint8)  # 100 rows that no fragment reaches
    evidence = PhotoEvidence("visual", scores(labels), rows, columns, 1.0, photo)
    write_map(tmp_path / "a" / "b.png", evidence, CLASSES, "alpha", "gamma")
    found = pixels(tmp_path / "a" / "b.png")
    assert max(found.shape) <= SIDE
    height, width = (round(size / 600 * found.shape[1]) for size in (400, 600))
    grey = np.full(3, 200 * 0.587)  # luma of ITU-R BT.601
    expected = {(0, 0): BLUE, (0, 1): YELLOW, (1, 0): RED, (1, 1): YELLOW}
    for (row, column), colour in expected.items():
        quarter = found[:height][row * height // 2 : (row + 1) * height // 2]
        quarter = quarter[:, column * width // 2 : (column + 1) * width // 2]
        np.testing.assert_allclose(quarter[1:-1, 1:-1] - (grey + colour) / 2, 0, atol=2)
    np.testing.assert_allclose(found[height + 1 :] - grey, 0, atol=2)


def test_of_a_right_sample_all_that_is_not_its_class_is_another(tmp_path):
    evidence = signal([1, 0], equal_parts(2, 0, 2), 2, 100.0)
    write_map(tmp_path / "a.png", evidence, CLASSES, "beta", "beta")
    found = pixels(tmp_path / "a.png")[0, :, :3]
    np.testing.assert_allclose(found[:100] - BLUE, 0, atol=0.5)
    np.testing.assert_allclose(found[100:] - YELLOW, 0, atol=0.5)


def test_a_strip_turns_between_fragments_and_is_transparent_before_the_movement(tmp_path):
    columns = np.array([[0.5, 1.5], [1.1, 2.1], [1.7, 2.7]])  # centres 1.0, 1.6, 2.2
    evidence = signal([0, 3, 2], columns, 3, 1000.0)
    write_map(tmp_path / "a.png", evidence, CLASSES, "alpha", "gamma")
    found = pixels(tmp_path / "a.png")[0]
    turns = np.flatnonzero(np.any(found[1:] != found[:-1], axis=1)) + 1
    np.testing.assert_allclose(turns * 3 / len(found), [0.5, 1.3, 1.9, 2.7], atol=0.01)
    assert found[0, 3] == found[-1, 3] == 0
    for turn, colour in zip(turns, (BLUE, YELLOW, RED), strict=False):
        np.testing.assert_allclose(found[turn], [*colour, 255], atol=0.5)


@pytest.mark.parametrize(
    ("seconds", "rate", "suffix"),
    [(3.0, 10_000, ".wav"), (9.0, 10_000, ".wav"), (9.0, 2000, ".npy")],  # whose rate is not in it
)
def test_a_strip_lies_below_the_same_time_of_the_spectrogram(tmp_path, seconds, rate, suffix):
    """A tone begins where the class turns: both are seen in the same column."""
    evidence = signal([0, 1], np.array([[0, 0.3], [0.3, 1]]) * seconds, seconds, rate)
    time = np.arange(int(seconds * rate)) / rate
    tone = np.where(time < evidence.edges[1], 1e-3, 0.9) * np.sin(np.pi / 4 * np.arange(len(time)))
    file = tmp_path / f"a{suffix}"
    if suffix == ".npy":
        np.save(file, tone)
    else:
        soundfile.write(file, tone, rate)
    write_outcomes([outcome(file, rate)], tmp_path / "predictions" / "haptic.csv")
    write_map(
        map_folder(tmp_path, "haptic") / "0/haptic/haptic.png", evidence, CLASSES, *CLASSES[:2]
    )
    (shown,) = shown_samples(tmp_path, ["haptic"])
    picture, sound = shown["media"]
    assert picture["name"] == "spectrogram, label map of haptic"
    found = opened(picture["content"])
    brightness = found[: SIDE // 3].sum(axis=2).max(axis=0)
    onset = np.flatnonzero(brightness > brightness.max() / 2)[0]
    turn = np.flatnonzero(np.abs(found[-5] - RED).sum(axis=1) < 60)[0]
    visible = min(seconds, 5)
    window = 512 / (visible * rate) * SIDE
    assert 0 < turn == pytest.approx(onset, abs=window)
    heard, heard_at = soundfile.read(raw(sound["content"]))
    assert len(heard) / heard_at == pytest.approx(visible)
    assert turn == pytest.approx(evidence.edges[1] / visible * SIDE, abs=2)


def test_a_recording_that_two_senses_look_at_has_a_map_of_each(tmp_path):
    photo = tmp_path / "a.png"
    Image.new("RGB", (90, 20)).save(photo)  # the networks read it at another aspect ratio
    write_outcomes([outcome(photo)], tmp_path / "predictions" / "fusion.csv")
    parts = equal_parts(1, 0, 30)
    black = np.zeros((20, 30, 3), np.uint8)
    for sense, label in (("one", 0), ("two", 1)):
        given = scores(np.array([[label]])), parts, parts, 1.0, black
        path = map_folder(tmp_path, "fusion") / "0" / "haptic" / f"{sense}.png"
        write_map(path, PhotoEvidence(sense, *given), CLASSES, *CLASSES[:2])
    (shown,) = shown_samples(tmp_path, ["fusion"])
    names = [medium["name"] for medium in shown["media"]]
    assert names == ["a.png", "label map of one", "label map of two"]
    for medium, colour in zip(shown["media"][1:], (BLUE, RED), strict=True):
        assert opened(medium["content"]).shape == (20, 90, 3)
        np.testing.assert_allclose(opened(medium["content"]) - colour / 2, 0, atol=4)
