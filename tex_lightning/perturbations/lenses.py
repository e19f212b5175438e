"""Perturbations of a photo by lens, motion and place of the camera: (height, width, 3) uint8 RGB.

What ImageNet-C (Hendrycks and Dietterich, 2019) has is in its unit, pixels, but of any size of
photo. Outside the photo lies its mirror image.
"""

import cv2
import numpy as np

from tex_lightning.perturbations.scene import Array, Scene

BORDER = cv2.BORDER_REFLECT_101
SMOOTH = 12.0  # pixels over which an elastic displacement changes
ZOOMS = 12  # photos that a zoom blur averages


def defocus_blur(photo: Array, radius: float, scene: Scene) -> Array:
    """Every point becomes a disk with a soft edge of one pixel."""
    distance = np.hypot(*_grid(radius + 1))
    return _filtered(photo, np.clip(radius + 0.5 - distance, 0, 1))


def gaussian_blur(photo: Array, deviation: float, scene: Scene) -> Array:
    """Blur with a deviation in pixels."""
    return photo if deviation <= 0 else cv2.GaussianBlur(photo, (0, 0), deviation, None, 0, BORDER)


def motion_blur(photo: Array, length: float, scene: Scene) -> Array:
    """Every point becomes a line of ``length`` pixels in any direction."""
    angle = np.pi * scene.rng.random()
    y, x = _grid(length / 2 + 1)
    along, aside = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    inside = np.clip(length / 2 + 0.5 - np.abs(along), 0, 1)
    return _filtered(photo, inside * np.clip(1 - np.abs(aside), 0, 1))


def zoom_blur(photo: Array, zoom: float, scene: Scene) -> Array:
    """The mean of photos enlarged by 1 to ``zoom`` about the centre."""
    total = np.zeros(photo.shape, np.float32)
    for factor in np.linspace(1, zoom, ZOOMS):
        total += _about_centre(photo, float(factor), 0.0)
    return total / ZOOMS


def pixelate(photo: Array, factor: float, scene: Scene) -> Array:
    """Shrunk by ``factor`` and enlarged again in blocks."""
    height, width = photo.shape[:2]
    small = _resized(photo, factor)
    return cv2.resize(small, (width, height), interpolation=cv2.INTER_NEAREST)


def elastic(photo: Array, displacement: float, scene: Scene) -> Array:
    """Every pixel moves by ``displacement`` pixels (root mean square) to a place near by."""
    height, width = photo.shape[:2]
    across = np.arange(width)[None] + _displacement(photo, displacement, scene)
    down = np.arange(height)[:, None] + _displacement(photo, displacement, scene)
    places = across.astype(np.float32), down.astype(np.float32)
    return cv2.remap(photo, places[0], places[1], cv2.INTER_LINEAR, borderMode=BORDER)


def rotation(photo: Array, degrees: float, scene: Scene) -> Array:
    """Turned about the centre, either way."""
    return _about_centre(photo, 1.0, degrees if scene.rng.random() < 0.5 else -degrees)


def nearer(photo: Array, factor: float, scene: Scene) -> Array:
    """The camera ``factor`` times nearer: the middle of the photo enlarged to its size."""
    return _about_centre(photo, factor, 0.0)


def scale_down(photo: Array, factor: float, scene: Scene) -> Array:
    """Fewer pixels: at 2 the photo is halved once too often."""
    return _resized(photo, 1 / factor)


def scale_up(photo: Array, factor: float, scene: Scene) -> Array:
    """More pixels by interpolation: at 2 as if halving was forgotten."""
    return _resized(photo, factor)


def tilt(photo: Array, degrees: float, scene: Scene) -> Array:
    """The camera tilted sideways or up and down; its focal length is the photo's longer side."""
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


def smaller_crop(photo: Array, share: float, scene: Scene) -> Array:
    """The middle of the photo, ``share`` of each side."""
    height, width = photo.shape[:2]
    rows, columns = max(1, round(share * height)), max(1, round(share * width))
    top, left = (height - rows) // 2, (width - columns) // 2
    return photo[top : top + rows, left : left + columns]


def _grid(reach: float) -> tuple[Array, Array]:
    places = np.arange(-int(np.ceil(reach)), int(np.ceil(reach)) + 1)
    return places[:, None], places[None]


def _displacement(photo: Array, size: float, scene: Scene) -> Array:
    field = scene.rng.standard_normal(photo.shape[:2], dtype=np.float32)
    smooth = cv2.GaussianBlur(field, (0, 0), SMOOTH, None, 0, BORDER)
    moved: Array = smooth * (size / float(np.std(smooth)))
    return moved


def _filtered(photo: Array, kernel: Array) -> Array:
    return cv2.filter2D(photo, -1, kernel / kernel.sum(), borderType=BORDER)


def _resized(photo: Array, factor: float) -> Array:
    """All of the photo with ``factor`` times as many pixels on each side, at least one."""
    size = (max(1, round(photo.shape[1] * factor)), max(1, round(photo.shape[0] * factor)))
    way = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
    return cv2.resize(photo, size, interpolation=way)


def _about_centre(photo: Array, zoom: float, degrees: float) -> Array:
    height, width = photo.shape[:2]
    matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), degrees, zoom)
    return cv2.warpAffine(photo, matrix, (width, height), flags=cv2.INTER_LINEAR, borderMode=BORDER)
