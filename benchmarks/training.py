"""What a training step costs beside the bare PyTorch loop that is in it.

``python -m benchmarks training``

HapticNet, VisualNet and FusionNet are trained one after another on the CPU by the default recipe,
on a few synthetic surfaces and by the package's own way, from the data module to the checkpoint of
every epoch. After every few steps a twin of the network, which started from the same weights,
takes as many in a bare loop (forward, loss, backward, optimiser, schedule) on input tensors kept
from the first epoch. The two take turns, so that a machine that slows down does so for both.

Left out of both: the first epoch (allocation, figures of the first batch, keeping the inputs), and
validation, which is no part of a step and is given by itself. The clock of the package is stopped
for the bare loop alone; what lies between two epochs, the checkpoint included, is shared out among
the steps of one.
"""

import tempfile
import time
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from lightning import Callback, LightningModule, Trainer
from torch import Tensor, nn

from benchmarks._classifiers import configured
from tex_lightning.classifier.card import configured_card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config
from tex_lightning.config.model import FUSION
from tex_lightning.core.devices import keep_memory
from tex_lightning.core.environment import environment
from tex_lightning.data.datamodule import Batch, SurfaceData, TrainingBatches
from tex_lightning.learning.module import SurfaceModule
from tex_lightning.learning.provenance import complete_recipe
from tex_lightning.learning.train import Training
from tex_lightning.studies.dataset import Dataset
from tex_lightning.studies.fold import open_training

CORE = ("forward", "backward", "optimiser")  # what a training step is for
PARTS = ("data", "augmentation", *CORE)
TURN = 5  # steps
SETTINGS = (
    "model=fusion",
    "data.synthetic.recordings=4",  # two of each class to train on, one to validate, one to test
    "trainer.accelerator=cpu",
    *(f"model.{kind}.fit.epochs=3" for kind in ("haptic", "visual", FUSION)),
)


class Clock:
    """Seconds spent on named parts, which do not contain each other."""

    def __init__(self) -> None:
        self.spent = dict.fromkeys(PARTS, 0.0)
        self.begun = 0.0

    def start(self, *_: object) -> None:
        self.begun = time.perf_counter()

    def stop(self, part: str) -> None:
        """Add the time since the last part ended, or the clock was started."""
        now = time.perf_counter()
        self.spent[part] += now - self.begun
        self.begun = now

    def timed(self, function: Callable[..., Any], part: str) -> Callable[..., Any]:
        def call(*arguments: object) -> Any:  # noqa: ANN401
            self.start()
            result = function(*arguments)
            self.stop(part)
            return result

        return call


@dataclass
class TimedBatches(TrainingBatches):
    """Training batches whose assembly is timed."""

    clock: Clock = field(default_factory=Clock)

    def __getitem__(self, step: int) -> Batch:
        self.clock.start()
        batch = super().__getitem__(step)
        self.clock.stop("data")
        return batch


class BareLoop:
    """Forward, loss, backward, optimiser and schedule on tensors in memory, and nothing else."""

    def __init__(self, module: SurfaceModule) -> None:
        card, pieces = module.classifier.card, module.hparams["pieces"]
        self.twin = twin = type(module)(card, module.fit_config, module.seed, pieces)
        twin.classifier = deepcopy(module.classifier)
        twin.train()
        twin.inputs = lambda inputs: inputs  # which are kept
        self.optimizer, schedule = twin.configure_optimizers().values()
        self.smoothing = twin.fit_config["label_smoothing"]
        self.scheduler = schedule["scheduler"]
        self.batches: list[tuple[list[Tensor], Tensor]] = []

    def turn(self) -> dict[str, float]:
        clock, begin = Clock(), time.perf_counter()
        for inputs, label in self.batches:
            clock.start()
            logits = self.twin.scores(inputs)
            clock.stop("forward")
            labels = label[:, None].expand(-1, logits.shape[2])
            loss = nn.functional.cross_entropy(logits, labels, label_smoothing=self.smoothing)
            self.optimizer.zero_grad()
            clock.start()
            loss.backward()
            clock.stop("backward")
            clock.start()
            self.optimizer.step()
            clock.stop("optimiser")
            self.scheduler.step()
        return {"step": time.perf_counter() - begin, **clock.spent}


class Turns(Callback):
    """After the first epoch, let the bare loop do as many steps after every few of the trainer."""

    def __init__(self) -> None:
        self.clock = Clock()
        self.turns: list[dict[str, float]] = []
        self.bare_turns: list[dict[str, float]] = []
        self.between: list[float] = []  # seconds from an epoch's last step to the next one's first
        self.validation: list[float] = []

    def on_fit_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        data = cast(SurfaceData, trainer.datamodule)
        data.batches = TimedBatches(**vars(data.batches), clock=self.clock)
        self.bare = BareLoop(cast(SurfaceModule, pl_module))

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        trainer.optimizers[0].register_step_post_hook(lambda *_: self.clock.stop("optimiser"))
        pl_module.inputs = self.clock.timed(pl_module.inputs, "augmentation")
        # scores begin with the inputs, whose end is where the forward pass starts
        pl_module.scores = self.clock.timed(pl_module.scores, "forward")

    def on_train_batch_start(
        self, trainer: Trainer, pl_module: LightningModule, batch: Batch, batch_idx: int
    ) -> None:
        if trainer.current_epoch == 0:
            if len(self.bare.batches) < TURN:
                inputs = pl_module.inputs(batch)
                self.bare.batches.append((inputs, batch["label"]))
            return
        now = time.perf_counter()
        if batch_idx == 0:
            self.between.append(now - self.ended - self.validation[-1])
            self.bare.turn()  # its caches are cold after an epoch's end
        elif batch_idx % TURN == 0:
            self.turns.append({"step": now - self.begun, **self.clock.spent})
            self.bare_turns.append(self.bare.turn())
        else:
            return
        self.clock.spent = dict.fromkeys(PARTS, 0.0)
        self.begun = time.perf_counter()

    def on_train_batch_end(self, trainer: Trainer, pl_module: LightningModule, *_: object) -> None:
        self.ended = time.perf_counter()
        self.validation.append(0.0)

    def on_before_backward(self, *_: object) -> None:
        self.clock.start()

    def on_after_backward(self, *_: object) -> None:
        self.clock.stop("backward")

    def on_before_optimizer_step(self, *_: object) -> None:
        self.clock.start()

    def on_validation_start(self, *_: object) -> None:
        self.validation[-1] -= time.perf_counter()

    def on_validation_end(self, *_: object) -> None:
        self.validation[-1] += time.perf_counter()

    def summary(self, steps: int) -> dict[str, Any]:
        """Medians in ms per step, their ratio, and what a step of the package is spent on."""
        package = {part: _median(self.turns, part) for part in ("step", *PARTS)}
        bare = {part: _median(self.bare_turns, part) for part in ("step", *CORE)}
        between = float(np.median(self.between)) * 1000
        package["step"] += between / steps
        shares = {part: package[part] / package["step"] for part in PARTS}
        return {
            "steps_timed": TURN * len(self.turns),
            "package_ms": package,
            "bare_ms": bare,
            "ratio": package["step"] / bare["step"],
            "shares": {**shares, "rest": 1 - sum(shares.values())},
            "share_beside_core": 1 - sum(shares[part] for part in CORE),
            "between_epochs_ms": between,
            "validation_ms": max(self.validation) * 1000,
        }


def _median(turns: list[dict[str, float]], part: str) -> float:
    return float(np.median([turn[part] for turn in turns])) * 1000 / TURN


def measure() -> dict[str, Any]:
    """Train all three networks and time their steps.

    Returns:
        ``environment`` and, by network, the entries of :meth:`Turns.summary`.
    """
    networks: dict[str, Any] = {}
    unimodal: dict[str, SurfaceClassifier] = {}
    keep_memory()
    with tempfile.TemporaryDirectory() as folder:
        config = configured(*SETTINGS)
        dataset, model = open_training(config, Path(folder)), config.model
        for kind in dict.fromkeys([*model.senses, model.kind]):
            watch = Turns()
            if kind == FUSION:
                _train(config, dataset, Path(folder), model.senses, unimodal, watch)
            else:
                unimodal[kind] = _train(config, dataset, Path(folder), [kind], {}, watch)
            networks[kind] = watch.summary(model.fit_values(kind)["steps_per_epoch"])
    return {"environment": environment(torch.device("cpu")), "networks": networks}


def _train(
    config: Config,
    dataset: Dataset,
    folder: Path,
    senses: list[str],
    unimodal: dict[str, SurfaceClassifier],
    watch: Turns,
) -> SurfaceClassifier:
    parts, store = dataset.parts(config.data), dataset.store
    card = configured_card(config, dataset.classes).of(senses)
    card = complete_recipe(config, card, parts, store, unimodal, {})
    return Training(config, card, parts, store, folder, unimodal, watchers=[watch]).run()
