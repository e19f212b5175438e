"""Perturbations of a photo by its sensor, its light and its file: (height, width, 3) uint8 RGB.

What ImageNet-C (Hendrycks and Dietterich, 2019) has is done as there, but for any size of photo.
Results are floats in 0 to 255 or uint8; the caller rounds them.
"""

import cv2
import numpy as np

from tex_lightning.perturbations.scene import Array, Scene

OCTAVES = 6  # of fog


def gaussian_noise(photo: Array, deviation: float, scene: Scene) -> Array:
    """Independent noise on every value; its deviation is a share of full scale."""
    return photo + 255 * deviation * _normal(photo, scene)


def shot_noise(photo: Array, photons: float, scene: Scene) -> Array:
    """Poisson noise with so many photons at full scale."""
    noisy: Array = scene.rng.poisson(photo * (photons / 255)) * (255 / photons)
    return noisy


def impulse_noise(photo: Array, share: float, scene: Scene) -> Array:
    """A share of the values becomes 0 or 255."""
    draw = scene.rng.random(photo.shape, dtype=np.float32)
    return np.where(draw < share / 2, 0, np.where(draw > 1 - share / 2, 255, photo))


def speckle_noise(photo: Array, deviation: float, scene: Scene) -> Array:
    """Noise in proportion to the value."""
    return photo * (1 + deviation * _normal(photo, scene))


def dead_pixels(photo: Array, share: float, scene: Scene) -> Array:
    """A share of the pixels is black in all colours."""
    dead = scene.rng.random(photo.shape[:2], dtype=np.float32) < share
    return np.where(dead[..., None], 0, photo)


def brightness(photo: Array, offset: float, scene: Scene) -> Array:
    """Value of hue, saturation and value raised by a share of full scale."""
    return _with_hsv(photo, value_offset=offset)


def darkness(photo: Array, factor: float, scene: Scene) -> Array:
    """Exposure too short: every value times ``factor``."""
    return photo * np.float32(factor)


def contrast(photo: Array, factor: float, scene: Scene) -> Array:
    """Distance from the mean of each colour times ``factor``."""
    mean = photo.mean(axis=(0, 1), dtype=np.float32)
    flat: Array = mean + np.float32(factor) * (photo - mean)
    return flat


def saturation(photo: Array, factor: float, scene: Scene) -> Array:
    """Saturation of hue, saturation and value times ``factor``; 0 is grey."""
    return _with_hsv(photo, saturation_factor=factor)


def light_colour(photo: Array, change: float, scene: Scene) -> Array:
    """Warmer or colder light: red and blue change by a share in opposite directions."""
    sign = 1 if scene.rng.random() < 0.5 else -1
    return photo * np.array([1 + sign * change, 1, 1 - sign * change], np.float32)


def light_gradient(photo: Array, loss: float, scene: Scene) -> Array:
    """Light from one side, any one: it falls off linearly and loses ``loss`` at the other side."""
    angle = 2 * np.pi * scene.rng.random()
    height, width = photo.shape[:2]
    across = np.linspace(-1, 1, width) * np.cos(angle)
    down = np.linspace(-1, 1, height)[:, None] * np.sin(angle)
    far = (across + down) / (abs(np.cos(angle)) + abs(np.sin(angle)))  # -1 to 1
    left: Array = (1 - loss * (far + 1) / 2).astype(np.float32)
    return photo * left[..., None]


def fog(photo: Array, strength: float, scene: Scene) -> Array:
    """A veil of noise with many octaves, as bright as ``strength`` times full scale."""
    height, width = photo.shape[:2]
    veil = np.zeros((height, width), np.float32)
    for octave in range(OCTAVES):
        grid = scene.rng.random((2**octave + 1, 2**octave + 1), dtype=np.float32)
        veil += cv2.resize(grid, (width, height), interpolation=cv2.INTER_CUBIC) / 2**octave
    veil = (veil - veil.min()) / max(float(np.ptp(veil)), 1e-6)
    top = float(photo.max())
    veiled = photo + 255 * np.float32(strength) * veil[..., None]
    result: Array = veiled * (top / max(top + 255 * strength, 1))
    return result


def jpeg(photo: Array, quality: float, scene: Scene) -> Array:
    """Compression; the quality is rounded to a whole number."""
    options = [cv2.IMWRITE_JPEG_QUALITY, round(quality)]
    _, content = cv2.imencode(".jpg", photo[..., ::-1], options)
    decoded = np.asarray(cv2.imdecode(content, cv2.IMREAD_COLOR))
    return decoded[..., ::-1]


def image_grey(photo: Array, share: float, scene: Scene) -> Array:
    """A share of the photos is mid-grey all over, as of a camera that is covered."""
    return np.full_like(photo, 128) if scene.rng.random() < share else photo


def _normal(photo: Array, scene: Scene) -> Array:
    return scene.rng.standard_normal(photo.shape, dtype=np.float32)


def _with_hsv(photo: Array, saturation_factor: float = 1, value_offset: float = 0) -> Array:
    hsv = cv2.cvtColor(photo.astype(np.float32) / 255, cv2.COLOR_RGB2HSV)
    hsv[..., 1] = np.clip(hsv[..., 1] * saturation_factor, 0, 1)
    hsv[..., 2] = np.clip(hsv[..., 2] + value_offset, 0, 1)
    return cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB) * 255
