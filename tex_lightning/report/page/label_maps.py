"""Label maps of test samples: which class every position said, small, for ``report.html``.

They lie in ``label_maps/NETWORK/ROW/MODALITY/SENSE.png`` of a run folder; ROW is the place of the
sample in ``predictions/NETWORK.csv``, from 0.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.colors import to_rgb
from PIL import Image

from tex_lightning.core.files import write_atomically
from tex_lightning.inference.evidence import Evidence, PhotoEvidence, SignalEvidence, nearest
from tex_lightning.report.evidence_panels import Key, overlaid
from tex_lightning.report.explanation import COLOURS

TRUE, TAKEN, OTHER = COLOURS[:3]
LEGEND = {"the true class": TRUE, "the one it was taken for": TAKEN, "any other": OTHER}
SIDE = 280  # pixels of a photo
PER_SECOND = 100  # pixels of a signal


def map_folder(directory: Path, network: str) -> Path:
    """Where a run folder has those of a network."""
    return directory / "label_maps" / network


def find_maps(directory: Path, network: str, row: int, modality: str) -> list[Path]:
    """Those of one recording, one of each sense that looks at it."""
    found = (map_folder(directory, network) / str(row) / modality).glob("*.png")
    return sorted(filter(Path.is_file, found))


def write_map(
    path: Path, evidence: Evidence, classes: Sequence[str], label: str, predicted: str
) -> None:
    """Write what a sense said of a sample as PNG.

    Args:
        path: The file.
        evidence: Of the sense.
        classes: Names in the order of the scores.
        label: The true class.
        predicted: The one it got.

    Raises:
        UserError: If it cannot be written.
    """
    named = {predicted: TAKEN, label: TRUE}  # right ones have the colour of the true class
    key = Key([*classes], 0, {i: named.get(name, OTHER) for i, name in enumerate(classes)})
    image = draw_map(evidence, key)
    write_atomically(path, lambda partial: image.save(partial, "PNG"))


def draw_map(evidence: Evidence, key: Key) -> Image.Image:
    """What every position said.

    Returns:
        Of a photo itself in grey, at most :data:`SIDE` pixels a side, under the colours of its
        classes. Of a signal a strip over the whole recording, one pixel high, :data:`PER_SECOND`
        long, transparent where no fragment reaches.
    """
    if isinstance(evidence, PhotoEvidence):
        step = -(-max(evidence.pixels.shape[:2]) // SIDE)
        return Image.fromarray((255 * overlaid(evidence, step, key)).round().astype(np.uint8))
    assert isinstance(evidence, SignalEvidence)  # there is no third kind
    count = max(1, round(evidence.seconds * PER_SECOND))
    places = nearest(evidence.columns, (np.arange(count) + 0.5) / count * evidence.seconds)
    colours = np.array([(*to_rgb(key.colour(i)), 1.0) for i in range(len(key.classes))])
    pixels = colours[evidence.labels[0, places]]
    pixels[places < 0] = 0
    return Image.fromarray((255 * pixels[None]).round().astype(np.uint8))
