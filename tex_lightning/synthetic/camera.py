"""Photos of a specimen: a hand-held camera, daylight or the light of a room."""

from functools import lru_cache
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from tex_lightning.synthetic.specimen import TILE, Field, Specimen

Light = Literal["daylight", "ambient"]
_NOISE_STARTS = 1 << 20


def render_photo(
    specimen: Specimen,
    rng: np.random.Generator,
    light: Light = "daylight",
    size: tuple[int, int] = (1280, 960),
) -> NDArray[np.uint8]:
    """Take one photo of a specimen (paper, section III-A, image data).

    Distance, rotation, tilt, place, focus, direction and colour of the light are drawn anew for
    each photo. A pixel covers 0.06 mm of the surface at the mean distance, whatever the size, so a
    smaller photo, whose size is its width and height in pixels, shows less of the surface, not a
    coarser view of it. Daylight is cool, bright and directed, ambient light warm, dim and mostly
    diffuse.

    Returns:
        Red, green and blue, shape (height, width, 3), gamma-encoded, in [0, 255].
    """
    view, turn = _draw_view(rng, size)
    lighting = _draw_lighting(rng, light, turn)
    photo: Any = cv2.warpPerspective(  # the stubs of OpenCV are wider
        _shade(specimen, lighting),
        view,
        size,
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_WRAP,
    )
    cv2.GaussianBlur(photo, (0, 0), rng.uniform(0.4, 1.4), dst=photo)
    photo.reshape(len(photo), -1)[:] *= _falloff(rng, size)
    # The square root is the gamma curve; it also makes shot noise equal at all grey levels.
    cv2.sqrt(photo, dst=photo)
    start = rng.integers(_NOISE_STARTS)
    noise = _noise(photo.size)[start : start + photo.size].reshape(photo.shape)
    pixels = cv2.addWeighted(noise, lighting["noise"], photo, 255, 0, dtype=cv2.CV_8U)
    return np.asarray(pixels, np.uint8)


def _draw_view(
    rng: np.random.Generator, size: tuple[int, int]
) -> tuple[NDArray[np.float64], float]:
    """Draw the homography from photo pixels to tile points, and the in-plane rotation in rad."""
    width, height = size
    distance = rng.uniform(0.85, 1.2)  # of the camera, as a multiple of the mean
    turn = np.deg2rad(rng.uniform(-25, 25))
    tilt = np.deg2rad(rng.uniform(-15, 15, 2))
    centre = np.array([[1, 0, -width / 2], [0, 1, -height / 2], [0, 0, 1.0]])
    # Focal length as long as a full frame is wide: a field of view of about 53 degrees.
    lean = np.diag([1 / np.cos(tilt[0]), 1 / np.cos(tilt[1]), 1.0])
    lean[2, :2] = -np.tan(tilt) / 1280
    cosine, sine = distance * np.cos(turn), distance * np.sin(turn)
    place = rng.uniform(0, TILE, 2)
    lay = np.array([[cosine, -sine, place[0]], [sine, cosine, place[1]], [0, 0, 1.0]])
    return lay @ lean @ centre, float(turn)


def _draw_lighting(rng: np.random.Generator, light: Light, turn: float) -> dict[str, Any]:
    """Draw the light; its direction is that of the lamp, noise is in grey levels."""
    daylight = light == "daylight"
    # The window stands to the upper left, the lamp to the upper right.
    azimuth = turn + np.deg2rad((-140 if daylight else -40) + rng.uniform(-40, 40))
    elevation = np.deg2rad(rng.uniform(30, 55) if daylight else rng.uniform(45, 70))
    horizontal = np.cos(elevation) * np.array((np.cos(azimuth), np.sin(azimuth)))
    cast = (0.95, 1.0, 1.06) if daylight else (1.12, 1.0, 0.84)
    return dict(
        direction=np.array((*horizontal, np.sin(elevation)), np.float32),
        diffuse=rng.uniform(0.25, 0.4) if daylight else rng.uniform(0.5, 0.65),
        colour=(np.array(cast) * rng.normal(1, 0.02, 3)).astype(np.float32),
        exposure=rng.uniform(1.0, 1.3) if daylight else rng.uniform(0.7, 0.95),
        noise=rng.uniform(1.0, 2.0) if daylight else rng.uniform(2.0, 4.0),
    )


def _shade(specimen: Specimen, lighting: dict[str, Any]) -> Field:
    """Give the linear radiance of the tile, shape (``TILE``, ``TILE``, 3)."""
    skin, direction = specimen.material.skin, lighting["direction"]
    lit = _facing(specimen, direction) / np.float32(direction[2])
    direct = np.float32((1 - lighting["diffuse"]) * lighting["exposure"])
    diffuse = np.float32(lighting["diffuse"] * lighting["exposure"])
    halfway = direction + np.array((0, 0, 1), np.float32)
    halfway /= np.linalg.norm(halfway)
    glint = cv2.pow(_facing(specimen, halfway), skin.shininess)
    highlight = direct * np.float32(skin.gloss) * glint
    shading = direct * lit + diffuse * specimen.occlusion
    lights = zip(specimen.albedo, lighting["colour"], strict=True)
    return np.asarray(cv2.merge([(plane * shading + highlight) * tint for plane, tint in lights]))


def _facing(specimen: Specimen, direction: NDArray[np.float32]) -> Field:
    """Multiply the surface normals with a direction; 0 where they point away from it."""
    x, y, z = specimen.normals
    return np.maximum(direction[0] * x + direction[1] * y + direction[2] * z, 0)


@lru_cache(maxsize=1)
def _noise(size: int) -> Field:
    """Draw noise of which photos of ``size`` numbers take a part: drawn for each it is slow."""
    return np.random.default_rng(0).standard_normal(size + _NOISE_STARTS, dtype=np.float32)


def _falloff(rng: np.random.Generator, size: tuple[int, int]) -> Field:
    """Let the light fade across the picture, shape (height, width * 3)."""
    width, height = size
    across, down = rng.uniform(-0.15, 0.15, 2)
    x = np.linspace(-across, across, width, dtype=np.float32)
    y = np.linspace(-down, down, height, dtype=np.float32)
    return np.repeat(1 + x, 3) + y[:, None]
