"""A fitted baseline as a classifier of raw recordings, saved and loaded like a network."""

import inspect
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from torch import Tensor, nn

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.checkpoint import read_checkpoint, reading
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config.instantiation import PACKAGE, make, make_value, trusted_class
from tex_lightning.config.signatures import TARGET
from tex_lightning.core.contract import breach, calling, describe_value
from tex_lightning.data.recordings import Recording, class_indices
from tex_lightning.data.store import LazyRecordings, Store, load_recording
from tex_lightning.errors import UserError
from tex_lightning.networks.archives import SizeLimit
from tex_lightning.networks.blocks import Level
from tex_lightning.senses.base import Sense
from tex_lightning.senses.features.dft321 import dft321, quick_length
from tex_lightning.senses.features.movement import moving
from tex_lightning.senses.photo import PhotoSense
from tex_lightning.senses.signal import SignalSense
from tex_lightning_runtime.files import expanded

if TYPE_CHECKING:
    from tex_lightning.baselines.base import Array, Baseline


WHERE = "model.baseline"


def make_baseline(name: str, node: Mapping[str, Any], budget: float) -> "Baseline":
    """Return a baseline that is not fitted yet.

    Raises:
        UserError: If a library is missing, or a key is unknown or of the wrong type.
    """
    try:
        baseline: Baseline = make(WHERE, node)
    except ModuleNotFoundError as error:
        if not node[TARGET].startswith(PACKAGE):  # whose author reads the traceback
            raise
        raise UserError(
            f"model={name} needs {error.name}, which is not installed; run: "
            "pip install 'tex_lightning[baselines]'"
        ) from error
    check_is_baseline(node[TARGET], baseline)
    return baseline.with_budget(budget) if budget != 1 else baseline


def check_is_baseline(name: str, baseline: object) -> None:
    """Reject an object of the class ``name`` that is no baseline of signals or of photos.

    Raises:
        UserError: If it does not derive from the base of all baselines, or has no kind.
    """
    from tex_lightning.baselines.base import Baseline

    if not isinstance(baseline, Baseline):
        raise UserError(
            f"{WHERE} names {name}, which is no baseline; derive it from "
            f"{Baseline.__module__}.{Baseline.__name__}."
        )
    if (kind := getattr(baseline, "kind", None)) not in ("haptic", "visual"):
        raise UserError(
            f"{WHERE} names {name}, whose kind is {kind}; let it be haptic for signals of any "
            "modality, or visual for photos."
        )


MIN_SECONDS = 0.05  # of movement: the paper's window


class Movement(nn.Module):
    """The steady movement of a signal, which baselines take in place of a spectrogram.

    Args:
        skip_impact: Leave out rests, and what comes before steady movement.
        sampling_rate: In Hz.
        apart: Keep several axes as they are, and do not join them to one.
    """

    counts_samples = True

    def __init__(self, skip_impact: bool, sampling_rate: float, *, apart: bool) -> None:
        super().__init__()
        self.skip_impact, self.sampling_rate, self.apart = skip_impact, sampling_rate, apart

    def forward(self, trace: Tensor) -> Tensor:
        """Map (axes, samples) to (1, 1, samples), or all axes, float32, without their mean.

        The last samples of several axes, fewer than 4 %, are left out where DFT321 of the rest is
        quick: a Fourier transform over a large prime takes many times as long.

        Raises:
            UserError: If there is too little movement.
        """
        axes = trace.float()
        if self.skip_impact:
            axes = moving(axes, self.sampling_rate)
        if axes.shape[1] < self.sampling_rate * MIN_SECONDS:
            raise UserError(
                f"The signal has {axes.shape[1] / self.sampling_rate:.2f} s of movement, too "
                "little to classify; record a longer stroke."
            )
        if len(axes) > 1 and not self.apart:
            return dft321(axes[:, : quick_length(axes.shape[1])])[None, None]
        return (axes - axes.mean(dim=1, keepdim=True))[None]


class Pixels(nn.Identity):
    """Photos as they are, 8 bits each, which baselines take in place of network input."""


class FittedBaseline(nn.Module):
    """A baseline in the place of a network: it scores one recording at a time, on the CPU."""

    def __init__(self, baseline: "Baseline") -> None:
        super().__init__()
        self.baseline = baseline
        self.min_size = (baseline.min_side, baseline.min_side)
        self.contract_part = WHERE, "baseline", baseline

    def get_extra_state(self) -> dict[str, Tensor]:
        """Return what was fitted."""
        with calling(*self.contract_part):
            return self.baseline.state()

    def set_extra_state(self, state: dict[str, Tensor]) -> None:
        """Load what was fitted."""
        with calling(*self.contract_part):
            self.baseline.load_state(state)

    def features(self, x: Tensor, level: Level) -> Tensor:
        """Return scores (1, classes, fragments) of an input of one recording.

        Raises:
            UserError: If the baseline gives none.
        """
        with calling(*self.contract_part):
            scores: object = self.baseline.logits(as_baseline_takes_it(x))
        if not isinstance(scores, Tensor) or scores.dim() != 2 or not scores.is_floating_point():
            raise breach(*self.contract_part, f"returned {describe_value(scores)} for a recording")
        return scores[None]


def as_baseline_takes_it(x: Tensor) -> "Array":
    """Return (samples,) or (axes, samples) of a signal, and (height, width, 3) of a photo.

    Args:
        x: Input (1, axes, samples) or (1, 3, height, width).
    """
    array: Array = (x[0] if x.dim() == 3 else x[0].permute(1, 2, 0)).numpy()
    return array[0] if x.dim() == 3 and len(array) == 1 else array


def _baseline_sense(card: Card, baseline: "Baseline") -> Sense:
    """Make the sense whose network is the baseline; the network of its node is not made."""
    (sense,), (values,) = card.sense_names, card.senses.values()
    kind = trusted_class(f"model.{sense}", values)
    medium = "signal" if baseline.kind == "haptic" else "photo"
    if kind.medium != medium:
        raise UserError(
            f"{card.title} looks at a {medium}, and {sense} is a {kind.medium}; choose "
            "another sense in model.senses, or leave it out."
        )
    decoder = kind.make_decoder(make_value(f"model.{sense}.decode", values["decode"]))
    network = FittedBaseline(baseline)
    if medium == PhotoSense.medium:
        return PhotoSense(sense, values["modality"], decoder, Pixels(), network)
    baseline.sampling_rate = decoder.sampling_rate
    rate, skips = decoder.sampling_rate, values.get("skip_impact", False)
    moving = Movement(skips, rate, apart=baseline.axes_apart)
    return SignalSense(sense, values["modality"], decoder, moving, network)


class BaselineClassifier(SurfaceClassifier):
    """Classify raw recordings of one sense with a baseline, on the CPU.

    Without a ``baseline``, fitted or about to be, that of the card is made.
    """

    baseline: "Baseline"

    def __init__(self, card: Card, baseline: "Baseline | None" = None) -> None:
        if baseline is None:
            baseline = make_baseline(*(card.baseline[key] for key in ("name", "node", "budget")))
        super().__init__(card, {card.kind: _baseline_sense(card, baseline)})
        self.baseline = baseline

    def fit(self, rows: Sequence[Recording], store: Store, seed: int) -> None:
        """Fit the baseline to recordings in a store, every class present.

        Their groups are given to a baseline that takes them.
        """
        fit: Any = self.baseline.fit
        sense = self.senses[self.card.kind]

        def load(row: Recording) -> "Array":
            return as_baseline_takes_it(sense(load_recording(row, store)))

        labels = np.array(class_indices([row.label for row in rows], self.card.classes))
        groups = [row.group_key for row in rows]
        with calling(WHERE, "baseline", self.baseline):
            more = {"groups": groups} if "groups" in inspect.signature(fit).parameters else {}
            fit(LazyRecordings(rows, load), labels, seed, **more)

    def count_parameters(self) -> int:
        """Count the numbers that were fitted."""
        return self.baseline.count_parameters()

    def weights(self) -> dict[str, Any]:
        """Return what was fitted."""
        return {"baseline": self.baseline.state()}


def load_classifier(path: str | Path) -> SurfaceClassifier:
    """Load a checkpoint of a network or of a baseline, ready to classify on the CPU.

    Raises:
        UserError: If the file cannot be used, or a library that the baseline needs is missing.
    """
    path, content = expanded(path), read_checkpoint(path)
    if not isinstance(content, dict) or "baseline" not in content:
        return SurfaceClassifier.from_content(path, content)
    with reading(path):
        card = Card.from_dict(content["hyper_parameters"]["card"])
        with SizeLimit(path.stat().st_size):
            classifier = BaselineClassifier(card)
            classifier.baseline.load_state(content["baseline"])
    return classifier
