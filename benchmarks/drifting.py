"""Synthetic textures whose spectra move with speed and force, which drift in every stroke.

``python -m benchmarks drifting`` trains ``few/haptic`` on five strokes of each of 100 textures and
tests five more, under the same conditions and from slow to fast. The logarithm of the spectrum is
linear in the logarithms of speed and force, along directions of each texture's own, besides a
change that all share; so a class is a plane. ``--rough=0.25`` adds a random function of both.
"""

from typing import Any

import numpy as np

import tex_lightning as tl

Array = np.ndarray
RATE, SIZE = 1_000, 64  # Hz, samples of the frames that are filtered
TERMS = 12  # of the cosines that a logarithmic spectrum consists of
SPEEDS, FORCES = (20 / 60, 200 / 60), (0.5 / 1.2, 3 / 1.2)  # of 60 mm/s and 1.2 N
SHARED = np.array([1.6, 0.9])  # powers of speed and force in the gain of every texture
TILT = np.array([0.5, 0.2])  # in the first cosine
LENGTH = 0.35  # in which the random function changes, of logarithms
WAVES = 30


class Textures:
    """Draw textures, and strokes over them.

    Args:
        classes: Number of textures.
        rough: Deviation of the random function of speed and force.
    """

    def __init__(self, classes: int, rough: float = 0.0) -> None:
        rng, f = np.random.default_rng(0), np.fft.rfftfreq(SIZE, 1 / RATE)
        decay = np.r_[1.0, np.arange(1, TERMS + 1) ** -0.7]
        self.cosines = np.cos(np.pi * np.outer(np.arange(TERMS + 1), np.linspace(0, 1, len(f))))
        peaks = ((2.5, 0.08, 0.03), (1.8, 0.21, 0.04), (1.0, 0.35, 0.05))  # of the tool
        self.tool = sum(h * np.exp(-(((f / RATE - c) / w) ** 2)) for h, c, w in peaks)
        spread = np.r_[0.5, np.full(TERMS, 0.3)]
        self.base = rng.normal(0, 1, (classes, TERMS + 1)) * spread * decay
        self.slopes = rng.normal(0, 0.4, (classes, 2, TERMS + 1)) * decay
        self.slopes[:, :, 0] += SHARED
        self.slopes[:, :, 1] -= TILT
        self.waves = rng.normal(0, 1 / LENGTH, (classes, 2, WAVES))
        self.phases = rng.uniform(0, 2 * np.pi, (classes, WAVES))
        self.heights = (
            rng.normal(0, rough * (2 / WAVES) ** 0.5, (classes, WAVES, TERMS + 1)) * decay
        )

    def spectra(self, texture: int, conditions: Array) -> Array:
        """Return logarithmic spectra (T, bins) at logarithms of speed and force (T, 2)."""
        waves = np.cos(conditions @ self.waves[texture] + self.phases[texture])
        terms = self.base[texture] + conditions @ self.slopes[texture]
        found: Array = self.tool + (terms + waves @ self.heights[texture]) @ self.cosines
        return found

    def stroke(self, texture: int, rng: np.random.Generator, speeds: tuple[float, float]) -> Array:
        """Return a stroke (samples,) of 3 to 5 s, its speed within limits."""
        hop = SIZE // 2
        frames = int(rng.uniform(3, 5) * RATE / hop)
        drifts = [drift(rng, frames + 1, *np.log(limits)) for limits in (speeds, FORCES)]
        gains = np.exp(self.spectra(texture, np.stack(drifts, axis=1)) / 2)
        noise, window = (
            rng.normal(size=(frames + 2) * hop),
            np.sin(np.pi * (np.arange(SIZE) + 0.5) / SIZE),
        )
        signal = np.zeros(len(noise))
        for number, gain in enumerate(gains):
            frame = slice(number * hop, number * hop + SIZE)
            signal[frame] += window * np.fft.irfft(np.fft.rfft(noise[frame] * window) * gain, SIZE)
        return signal[hop:-hop]


def drift(rng: np.random.Generator, frames: int, low: float, high: float) -> Array:
    """Return a random walk (frames,) that is mirrored at its limits, with two steps a second."""
    points = int(2 * frames * SIZE / 2 / RATE) + 4
    walk = np.cumsum(rng.normal(0, 0.25, points)) + rng.uniform(low, high)
    folded = np.abs((walk - low + high - low) % (2 * (high - low)) - (high - low))
    return np.interp(np.linspace(0, points - 1, frames), np.arange(points), low + folded)


def measure(rough: str = "0", classes: str = "100") -> dict[str, Any]:
    """Return how many strokes are right, under the same conditions and from slow to fast."""
    textures, rng = Textures(int(classes), float(rough)), np.random.default_rng(1)
    middle = (SPEEDS[0] * SPEEDS[1]) ** 0.5
    shifts = {"same": (SPEEDS, SPEEDS), "slow to fast": ((SPEEDS[0], middle), (middle, SPEEDS[1]))}
    labels = [str(texture) for texture in range(int(classes)) for _ in range(5)]
    figures = {}
    for name, limits in shifts.items():
        train, test = ([textures.stroke(int(x), rng, some) for x in labels] for some in limits)
        model = tl.Estimator("few/haptic", rate=RATE).fit(train, labels)
        right = sum(x == y for x, y in zip(model.predict(test), labels, strict=True))
        figures[name] = f"{right} of {len(labels)}"
    return figures
