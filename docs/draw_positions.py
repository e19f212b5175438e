"""Draw ``positions.png``: what a trained FusionNet says of every position, beside the truth.

``python docs/draw_positions.py RUN`` takes a run of ``python -m tex_lightning model=fusion``. It
joins two of its test samples, the best known and the middle one of all that the networks know:
the second halves of two traces, and halves of two photos. The surfaces are synthetic.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure
from matplotlib.patches import Patch

import tex_lightning as tl
from tex_lightning.core.run_folder import predictions_of
from tex_lightning.evaluation.outcomes import read_outcomes
from tex_lightning.report.pictures import input_pixels
from tex_lightning.report.style import COLOURS, styled

OUT = Path(__file__).with_name("positions.png")
OTHER = "#bbbbbb"


def two_samples(run: Path) -> list[dict[str, str]]:
    """Return files by modality, and the class, of two samples that fusion knows."""
    known = [each for each in read_outcomes(predictions_of(run, "fusion"))
             if each.label == each.predicted]  # fmt: skip
    by_file = {
        file: outcome.correct_fragments / outcome.fragments
        for name in ("haptic", "visual")
        for outcome in read_outcomes(predictions_of(run, name))
        for file in outcome.files.values()
    }
    known.sort(key=lambda each: min(by_file[file] for file in each.files.values()))
    usable = [each for each in known if min(by_file[f] for f in each.files.values()) > 0.5]
    return [{**each.files, "label": each.label} for each in (usable[len(usable) // 2], usable[-1])]


def joined(run: Path) -> dict[str, torch.Tensor]:
    """Return by sense one recording of two surfaces, as the networks take it."""
    model, files = tl.load(run), two_samples(run)
    recordings = {}
    for name, sense in model.classifier.senses.items():
        how: Any = {"rate": None, "colour": "rgb", "channels": None, "time_unit": None}
        arrays = [sense.decode_input(each[sense.modality], {}, **how)[0] for each in files]
        if sense.medium == "photo":
            half = min(array.shape[1] for array in arrays) // 2
            parts = [arrays[0][:, :half], arrays[1][:, -half:]]
            recordings[name] = torch.cat(parts, dim=1)
        else:  # without the touch that begins a stroke
            recordings[name] = torch.cat([array[:, array.shape[1] // 2 :] for array in arrays], 1)
    return recordings


@styled
def draw(run: Path) -> None:
    """Draw both recordings, the prediction of each position and the truth."""
    model, labels = tl.load(run), [each["label"] for each in two_samples(run)]
    classes, said = model.classes, []
    figure = Figure(figsize=(8, 4.4), layout="constrained")
    grid = figure.subplots(3, 2, height_ratios=(6, 1.6, 1.6))
    with torch.inference_mode():
        for column, (name, recording) in enumerate(joined(run).items()):
            sense = model.classifier.senses[name]
            found = model.classifier.fragment_scores(name, recording).argmax(dim=0).numpy()
            truth = np.array([classes.index(label) for label in labels]).repeat(50)[None]
            places = (np.arange(found.shape[1]) + 0.5) / found.shape[1]
            right = found == np.array([classes.index(labels[int(at >= 0.5)]) for at in places])
            said.append(f"{name} {right.mean():.0%} of {right.size}")
            if sense.medium == "photo":
                grid[0, column].imshow(recording.numpy(), aspect="auto")
            else:
                pixels = input_pixels(sense(recording)[0], sense.features, 2000)
                grid[0, column].imshow(pixels, aspect="auto")
            for row, values in ((1, found), (2, truth)):
                strip = _coloured(values, labels, classes)
                grid[row, column].imshow(strip, aspect="auto", interpolation="nearest")
            grid[0, column].set_title(f"{sense.medium} of two surfaces")
            for row, title in enumerate(("", "prediction", "truth")):
                grid[row, column].set(xticks=[], yticks=[], ylabel=title)
    patches = [Patch(color=COLOURS[n], label=label) for n, label in enumerate(labels)]
    figure.legend(handles=[*patches, Patch(color=OTHER, label="any other class")],
                  loc="outside lower center", ncols=3)  # fmt: skip
    figure.savefig(OUT, dpi=120)
    print(f"Positions that agree with the truth: {'; '.join(said)}.")


def _coloured(values: np.ndarray, labels: list[str], classes: list[str]) -> np.ndarray:
    colours = {classes.index(label): COLOURS[n] for n, label in enumerate(labels)}
    hexes = np.vectorize(lambda value: colours.get(value, OTHER))(values)
    return np.array(
        [[[int(cell[i : i + 2], 16) for i in (1, 3, 5)] for cell in row] for row in hexes]
    )


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
