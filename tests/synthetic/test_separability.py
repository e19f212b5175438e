"""What a plain linear classifier on textbook features makes of the surfaces."""

import cv2
import numpy as np
import pytest
from scipy.signal import stft
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from tex_lightning.synthetic.dataset import SyntheticSpec, listen, photograph, record

SPEC = SyntheticSpec(classes=6, seconds=2, photo_width=320, photo_height=240)
TESTED = np.isin(np.arange(10), [4, 9])


def _haptic_features(trace):
    _, _, spectrum = stft(trace[:, 8000:], 10_000, "hamming", 500, 400)
    return _bands(np.square(np.abs(spectrum[:, 1:50])).sum(axis=0))


def _sound_features(sound):
    _, _, spectrum = stft(sound[35_280:], 44_100, "hamming", 441, 341)
    return _bands(np.square(np.abs(spectrum[1:])), 200)


def _bands(power, last=40):
    bands = np.log(np.add.reduceat(power, np.geomspace(1, last, 12).astype(int), axis=0))
    return np.concatenate([bands.mean(axis=1), bands.std(axis=1)])


def _visual_features(photo):
    grey = cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY).astype(np.float32)
    features = [*np.log(photo.mean(axis=(0, 1))), *np.log(photo.std(axis=(0, 1)))]
    for sigma in (1, 2, 4, 8):
        blurred = cv2.GaussianBlur(grey, (0, 0), sigma)
        for order in ((1, 0), (0, 1)):
            slope = np.abs(cv2.Sobel(blurred, cv2.CV_32F, *order))
            features.append(np.log(slope.mean() / grey.mean()))
    return np.array(features)


def _confusions(features):
    """Train on eight recordings of each class, test on two; give (class, predicted) pairs."""
    classes = len(features)
    labels = np.repeat(np.arange(classes), 10).reshape(classes, 10)
    model = make_pipeline(
        StandardScaler(), LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto")
    )
    model.fit(features[:, ~TESTED].reshape(-1, features.shape[-1]), labels[:, ~TESTED].ravel())
    predicted = model.predict(features[:, TESTED].reshape(-1, features.shape[-1]))
    return list(zip(labels[:, TESTED].ravel(), predicted, strict=True))


@pytest.mark.parametrize(
    ("take", "describe", "twins"),
    [
        (record, _haptic_features, {2, 3}),
        (photograph, _visual_features, {0, 1}),
        (listen, _sound_features, {4, 5}),
    ],
    ids=["haptic", "visual", "sound"],
)
def test_all_but_the_twins_are_told_apart(specimen, take, describe, twins):
    features = np.array(
        [[describe(take(SPEC, specimen(i), i, n)) for n in range(10)] for i in range(6)]
    )
    wrong = [
        (true, seen)
        for true, seen in _confusions(features)
        if true != seen and not {true, seen} <= twins
    ]
    assert not wrong
