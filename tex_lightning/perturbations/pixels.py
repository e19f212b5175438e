"""Perturbations of a photo by sensor, light, file, lens, motion and position of the camera.

Photos are (height, width, 3) uint8 RGB. What ImageNet-C (Hendrycks and Dietterich, 2019) has is
done as there, but for any size of photo. Results are floats in 0 to 255 or uint8; the caller
rounds them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Scene:
    """The circumstances of one recording.

    Attributes:
        rng: Generator of everything random, seeded by the recording and the perturbation and not by
            the severity, so that a severer one adds to a milder one instead of being drawn anew.
        rate: Sampling rate of a signal in Hz; 0 for a photo.
    """

    rng: np.random.Generator
    rate: float


Function = Callable[[Array, float, Scene], Array]


def gaussian_noise(photo: Array, deviation: float, scene: Scene) -> Array:
    """Add independent noise to every value; its deviation is a share of full scale."""
    noise: Array = scene.rng.standard_normal(photo.shape, dtype=np.float32)
    return photo + 255 * deviation * noise


def shot_noise(photo: Array, photons: float, scene: Scene) -> Array:
    """Draw Poisson noise with so many photons at full scale."""
    noisy: Array = scene.rng.poisson(photo * (photons / 255)) * (255 / photons)
    return noisy


def impulse_noise(photo: Array, share: float, scene: Scene) -> Array:
    """Set a share of the values to 0 or 255."""
    draw = scene.rng.random(photo.shape, dtype=np.float32)
    return np.where(draw < share / 2, 0, np.where(draw > 1 - share / 2, 255, photo))


def brightness(photo: Array, offset: float, scene: Scene) -> Array:
    """Raise the value (of HSV) by a share of full scale."""
    hsv = cv2.cvtColor(photo.astype(np.float32) / 255, cv2.COLOR_RGB2HSV)
    hsv[..., 2] = np.clip(hsv[..., 2] + offset, 0, 1)
    return cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB) * 255


def darkness(photo: Array, factor: float, scene: Scene) -> Array:
    """Multiply every value by ``factor``, as of too short an exposure."""
    return photo * np.float32(factor)


def contrast(photo: Array, factor: float, scene: Scene) -> Array:
    """Multiply the distance from the mean of each colour by ``factor``."""
    mean = photo.mean(axis=(0, 1), dtype=np.float32)
    flat: Array = mean + np.float32(factor) * (photo - mean)
    return flat


def light_colour(photo: Array, change: float, scene: Scene) -> Array:
    """Change red and blue by a share in opposite directions: warmer or colder light."""
    sign = 1 if scene.rng.random() < 0.5 else -1
    return photo * np.array([1 + sign * change, 1, 1 - sign * change], np.float32)


def desaturation(photo: Array, share: float, scene: Scene) -> Array:
    """Remove a share of the colour; at 1 the photo is grey."""
    grey: Array = cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY)[..., None].astype(np.float32)
    return grey + np.float32(1 - share) * (photo - grey)


def light_gradient(photo: Array, loss: float, scene: Scene) -> Array:
    """Light the photo from a random side, falling off linearly by ``loss`` to the other."""
    angle = 2 * np.pi * scene.rng.random()
    height, width = photo.shape[:2]
    across = np.linspace(-1, 1, width) * np.cos(angle)
    down = np.linspace(-1, 1, height)[:, None] * np.sin(angle)
    far = (across + down) / (abs(np.cos(angle)) + abs(np.sin(angle)))  # -1 to 1
    left: Array = (1 - loss * (far + 1) / 2).astype(np.float32)
    return photo * left[..., None]


def jpeg(photo: Array, quality: float, scene: Scene) -> Array:
    """Compress the photo; the quality is rounded to a whole number."""
    options = [cv2.IMWRITE_JPEG_QUALITY, round(quality)]
    _, content = cv2.imencode(".jpg", photo[..., ::-1], options)
    decoded = np.asarray(cv2.imdecode(content, cv2.IMREAD_COLOR))
    return decoded[..., ::-1]


def image_grey(photo: Array, share: float, scene: Scene) -> Array:
    """Grey a share of the photos, like a covered camera."""
    return np.full_like(photo, 128) if scene.rng.random() < share else photo


BORDER = cv2.BORDER_REFLECT_101


def defocus_blur(photo: Array, radius: float, scene: Scene) -> Array:
    """Spread every point to a disk with a soft edge of one pixel."""
    distance = np.hypot(*_grid(radius + 1))
    return _filtered(photo, np.clip(radius + 0.5 - distance, 0, 1))


def gaussian_blur(photo: Array, deviation: float, scene: Scene) -> Array:
    """Blur with a deviation in pixels."""
    return photo if deviation <= 0 else cv2.GaussianBlur(photo, (0, 0), deviation, None, 0, BORDER)


def motion_blur(photo: Array, length: float, scene: Scene) -> Array:
    """Spread every point to a line of ``length`` pixels in any direction."""
    angle = np.pi * scene.rng.random()
    y, x = _grid(length / 2 + 1)
    along, aside = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    inside = np.clip(length / 2 + 0.5 - np.abs(along), 0, 1)
    return _filtered(photo, inside * np.clip(1 - np.abs(aside), 0, 1))


def rotation(photo: Array, degrees: float, scene: Scene) -> Array:
    """Rotate the photo about its centre, in either direction."""
    return _about_centre(photo, 1.0, degrees if scene.rng.random() < 0.5 else -degrees)


def nearer(photo: Array, factor: float, scene: Scene) -> Array:
    """Enlarge the middle of the photo to its size: the camera is ``factor`` times nearer."""
    return _about_centre(photo, factor, 0.0)


def scale_down(photo: Array, factor: float, scene: Scene) -> Array:
    """Reduce the photo by ``factor``: at 2 it is halved once too often."""
    return _resized(photo, 1 / factor)


def scale_up(photo: Array, factor: float, scene: Scene) -> Array:
    """Interpolate more pixels: at 2 as if halving was forgotten."""
    return _resized(photo, factor)


def tilt(photo: Array, degrees: float, scene: Scene) -> Array:
    """Tilt the camera sideways or up and down; its focal length is the photo's longer side."""
    height, width = photo.shape[:2]
    focal, angle = max(height, width), np.deg2rad(degrees)
    cos, sin = np.cos(angle), np.sin(angle)
    lens = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
    turn = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
    if scene.rng.random() < 0.5:
        turn = np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])
    flat = np.column_stack([turn[:, :2], [0, 0, 1.0]])  # the surface turned, at distance 1
    matrix = lens @ flat @ np.linalg.inv(lens)
    return cv2.warpPerspective(
        photo, matrix, (width, height), flags=cv2.INTER_LINEAR, borderMode=BORDER
    )


def _grid(reach: float) -> tuple[Array, Array]:
    places = np.arange(-int(np.ceil(reach)), int(np.ceil(reach)) + 1)
    return places[:, None], places[None]


def _filtered(photo: Array, kernel: Array) -> Array:
    return cv2.filter2D(photo, -1, kernel / kernel.sum(), borderType=BORDER)


def _resized(photo: Array, factor: float) -> Array:
    """Resize the photo to ``factor`` times as many pixels on each side, at least one."""
    size = (max(1, round(photo.shape[1] * factor)), max(1, round(photo.shape[0] * factor)))
    way = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    return cv2.resize(photo, size, interpolation=way)


def _about_centre(photo: Array, zoom: float, degrees: float) -> Array:
    height, width = photo.shape[:2]
    matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), degrees, zoom)
    return cv2.warpAffine(photo, matrix, (width, height), flags=cv2.INTER_LINEAR, borderMode=BORDER)
