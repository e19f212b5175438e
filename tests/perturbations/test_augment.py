from dataclasses import replace

import numpy as np
import pytest

from tex_lightning.perturbations.table import Augmentation, perturbations, trainable

TRACE = np.random.default_rng(0).standard_normal((1, 20_000)).astype(np.float32)
PHOTO = np.random.default_rng(1).integers(0, 256, (60, 80, 3), dtype=np.uint8)


def test_what_is_held_out_cannot_be_trained_on():
    names = {*trainable("haptic"), *trainable("image"), *trainable("sound")}
    assert {"white_noise", "jpeg", "sound_low_pass"} <= names
    assert trainable("thermal") == ()
    left = [kind for name, kind in perturbations().items() if name not in names]
    assert all(kind.held_out or kind.modality == "both" for kind in left)


@pytest.mark.parametrize(
    ("modality", "recording"), [("haptic", TRACE), ("image", PHOTO), ("sound", TRACE)]
)
def test_all_that_may_be_trained_on_needs_the_recording_alone(modality, recording):
    for name in trainable(modality):
        augmentation = Augmentation.of([name], rate=10_000.0)
        changed = augmentation(recording, np.random.default_rng(2))
        assert changed.dtype == recording.dtype
        assert changed.ndim == recording.ndim
        again = augmentation(recording, np.random.default_rng(2))
        assert np.array_equal(changed, again)


def test_a_share_is_changed_by_every_kind_alike():
    augmentation = Augmentation.of(["darkness", "scale_down"], share=0.5)
    changed = [augmentation(PHOTO, np.random.default_rng(seed)) for seed in range(400)]
    smaller = sum(each.shape != PHOTO.shape for each in changed)
    darker = sum(each.shape == PHOTO.shape and each is not PHOTO for each in changed)
    assert 70 < smaller < 130
    assert 70 < darker < 130
    never = replace(augmentation, share=0.0)
    assert never(PHOTO, np.random.default_rng(0)) is PHOTO
