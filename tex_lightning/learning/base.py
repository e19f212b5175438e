"""Training of the network of one sense: loss, metrics, optimiser and checkpoint."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Self

import torch
from lightning import LightningModule
from torch import Tensor, nn
from torch.optim.lr_scheduler import LRScheduler, ReduceLROnPlateau
from torchmetrics import Metric, MetricCollection
from torchmetrics.classification import (
    BinaryAUROC,
    BinaryCalibrationError,
    MulticlassAccuracy,
    MulticlassConfusionMatrix,
)

from tex_lightning.classifier.card import LEFT_OUT, Card, read_checkpoint
from tex_lightning.classifier.classifier import SurfaceClassifier, own_state
from tex_lightning.classifier.vote import Vote
from tex_lightning.config.instantiation import build, call
from tex_lightning.config.model import FUSION
from tex_lightning.core.contract import breach, calling, describe
from tex_lightning.data.datamodule import Batch
from tex_lightning.errors import UserError
from tex_lightning.evaluation.calibration import BINS
from tex_lightning.learning.loggers import log_figures
from tex_lightning.networks.blocks import is_builtin
from tex_lightning.report.figures import confusion_figure

REFRESH = 5  # steps, after which the progress bar shows new figures
CONFUSION = "confusion"  # a matrix, which is drawn and not logged
THRESHOLDS = 1000  # of the ROC curve, so that its memory does not grow with the samples
APART = 1 << 50  # between the dropout of two processes, more than seeds and epochs span


class SurfaceModule(LightningModule):
    """Train a :class:`SurfaceClassifier` on pieces of recordings.

    Every position of a piece is a fragment with the label of its recording.

    Logged: ``train/loss`` (cross entropy per fragment, lower is better), the share of correct
    fragments as ``train/fragment_accuracy`` (higher is better), ``lr/backbone`` and ``lr/head``;
    with a validation fold ``val/loss`` and the metrics of
    :func:`vote_metrics`; the same of testing as ``test/...``.

    Args:
        card: What is trained.
        fit: The training recipe as a dictionary of plain values.
        seed: Seed of dropout; batches have their own.
        pieces: By sense the length or side of the pieces.
    """

    def __init__(self, card: Card, fit: dict[str, Any], seed: int, pieces: dict[str, int]) -> None:
        super().__init__()
        kept = {"card": card.to_dict(), "fit": fit, "seed": seed, "pieces": pieces}
        self.save_hyperparameters(kept, logger=False)
        self.classifier, self.kind = SurfaceClassifier(card), card.kind
        self.layout = training_layout(self.classifier)
        if self.kind != FUSION:
            self.network.to(memory_format=self.layout)
        self.fit_config, self.seed, self.pieces = fit, seed, pieces
        node, key = fit.get("augmentation"), f"model.{self.kind}.fit.augmentation"
        self.augmentation: Any = None if node is None else build(key, node)
        self.fit_seconds = 0.0
        self.val_loss: float | None = None
        self.left_out: dict[str, list[float]] = {}
        classes = len(card.classes)
        self.train_accuracy = accuracy(classes)
        self.val_metrics = vote_metrics(classes, "val")
        self.test_metrics = vote_metrics(classes, "test")

    @classmethod
    def load_from_checkpoint(  # type: ignore[override]  # Lightning's is no plain class method
        cls,
        checkpoint_path: str | Path,
        map_location: str | torch.device | None = None,
        hparams_file: None = None,
        strict: bool | None = None,
        weights_only: bool | None = None,
        **kwargs: Any,  # noqa: ANN401
    ) -> Self:
        """Load a network as :meth:`.SurfaceClassifier.from_checkpoint` does, to test and predict.

        Optimiser, schedule and augmentation, which the stored recipe names, are not made: a
        checkpoint is data. Give the argument ``fit`` to train on.

        Raises:
            UserError: If the file cannot be used, or names a class that is not trusted.
        """
        path = Path(checkpoint_path).expanduser()
        content = read_checkpoint(path)
        classifier = SurfaceClassifier.from_content(path, content)
        stored = {key: content["hyper_parameters"][key] for key in ("fit", "seed", "pieces")}
        fit = {key: value for key, value in stored["fit"].items() if not isinstance(value, dict)}
        module = cls(classifier.card, **{**stored, "fit": fit, **kwargs})
        module.classifier = classifier
        return module if map_location is None else module.to(map_location)

    def inputs(self, batch: Batch) -> list[Tensor]:
        """The network's input tensors (batch, ...) for a training batch, one for each sense."""
        change = self._augmented if self.augmentation is not None and self.training else None
        found = []
        for name, sense in self.classifier.senses.items():
            x = sense.training_input(batch[name], self.pieces[name], change)
            found.append(x.contiguous() if self.layout is torch.contiguous_format else x)
        return found

    def _augmented(self, patches: Tensor) -> Tensor:
        """Apply the recipe's augmentation to photos (batch, 3, side, side) in [0, 1]."""
        part = f"model.{self.kind}.fit.augmentation", "augmentation", self.augmentation
        with calling(*part):
            pixels: object = self.augmentation(patches)
        if not isinstance(pixels, Tensor) or pixels.dim() != 4 or len(pixels) != len(patches):
            raise breach(*part, f"returned {describe(pixels)} for a batch of {len(patches)}")
        return pixels

    @property
    def network(self) -> Any:  # noqa: ANN401
        """The network of a single sense."""
        return self.classifier.network

    def backbone_parameters(self) -> Iterator[nn.Parameter]:
        """Parameters at the base learning rate: the trunk's, or of a network without one all."""
        yield from getattr(self.network, "trunk", self.network).parameters()

    def head_parameters(self) -> Iterator[nn.Parameter]:
        """Parameters at ``head_factor`` times the base learning rate: the other ones."""
        trunk = set(self.backbone_parameters())
        yield from (each for each in self.network.parameters() if each not in trunk)

    def scores(self, batch: Batch) -> Tensor:
        """Class scores (batch, classes, fragments) of a training batch."""
        return self.scores_of(self.inputs(batch))

    def scores_of(self, inputs: list[Tensor]) -> Tensor:
        """Class scores of the network's input tensors, one for each sense."""
        (x,), (sense,) = inputs, self.classifier.senses.values()
        return sense.score(x, "fc3").flatten(2)

    def on_train_epoch_start(self) -> None:
        """Make dropout a function of seed, epoch and process: a resumed run repeats it exactly."""
        torch.manual_seed(self.global_rank * APART + self.seed * 100_003 + self.current_epoch)
        self.train_accuracy.reset()

    def training_step(self, batch: Batch, batch_idx: int) -> Tensor:
        """Cross entropy of every fragment against the label of its sample."""
        logits = self.scores(batch)
        labels = batch["label"][:, None].expand(-1, logits.shape[2])
        loss = nn.functional.cross_entropy(
            logits, labels, label_smoothing=self.fit_config["label_smoothing"]
        )
        every = self.trainer.log_every_n_steps  # type: ignore[attr-defined]  # set by a connector
        logged = (self.global_step + 1) % every == 0
        if logged or (batch_idx + 1) % REFRESH == 0:  # the others would be seen by nobody
            share = self.train_accuracy(logits.detach().argmax(dim=1), labels)
            shown = {"train/loss": loss.detach(), "train/fragment_accuracy": share}
            self.log_dict(shown, prog_bar=True, batch_size=len(labels), sync_dist=True)
        if logged:
            for group in self.trainer.optimizers[0].param_groups:
                self.log(f"lr/{group['name']}", group["lr"], batch_size=len(labels))
        return loss

    def validation_step(self, batch: Batch, batch_idx: int) -> None:
        """Classify a whole sample as in testing."""
        self._evaluate(batch, "val", self.val_metrics)

    def test_step(self, batch: Batch, batch_idx: int) -> None:
        """Classify a whole sample as prediction would."""
        self._evaluate(batch, "test", self.test_metrics)

    def predict_step(self, batch: Batch, batch_idx: int) -> dict[str, Any]:
        """Decide on a whole sample; return the fields of its :class:`Vote`.

        Lightning moves results to the CPU, which it cannot do in a frozen dataclass.
        """
        return vars(self._decide(self._whole_scores(batch)))

    def _whole_scores(self, batch: Batch) -> Tensor:
        """Class scores (classes, fragments) of a whole sample."""
        return self.classifier.logits(**batch["recordings"])

    def _decide(self, scores: Tensor) -> Vote:
        return self.classifier.decide(scores, self.classifier.card.temperature)

    def _evaluate(self, batch: Batch, stage: str, metrics: MetricCollection) -> None:
        scores, label = self._whole_scores(batch), batch["label"]
        decided = scores
        if stage == "val" and not bool(scores.isfinite().all()):  # weights that diverge end nothing
            decided = -nn.functional.one_hot(label, len(scores))[:, None].float()  # an error
        update_metrics(metrics, self._decide(decided), label)
        loss = nn.functional.cross_entropy(scores.T, label.expand(scores.shape[1]))
        # Lightning rounds the mean number of samples of the processes down; this divides evenly
        count = self.trainer.world_size
        self.log(f"{stage}/loss", loss, prog_bar=True, batch_size=count, sync_dist=True)

    def on_validation_epoch_end(self) -> None:
        """Log the metrics of the votes, once: Lightning looks at all they keep each time."""
        self._log_votes(self.val_metrics)

    def _log_votes(self, metrics: MetricCollection) -> None:
        for name, metric in metrics.items():
            if not name.endswith(CONFUSION):
                self.log(name, metric, prog_bar=True)

    def on_test_epoch_end(self) -> None:
        """Log the metrics of the votes, and draw the confusion matrix for the loggers."""
        self._log_votes(self.test_metrics)
        confusion = self.test_metrics[CONFUSION]
        counts = confusion.compute().cpu().numpy()
        confusion.reset()
        title = f"votes on {counts.sum()} test samples"
        figure = confusion_figure(counts, self.classifier.card.classes, title)
        log_figures(self.trainer.loggers, {f"test/{CONFUSION}": figure})

    def configure_optimizers(self) -> Any:  # noqa: ANN401  (Lightning's union of unions)
        """Make two named groups up front, for every scheduler and for resumption.

        The scheduler steps after every batch. It gets the number of steps and the largest rates of
        both groups where its class takes them.

        Raises:
            UserError: If one of the two cannot be made, or is none.
        """
        backbone, head = list(self.backbone_parameters()), list(self.head_parameters())
        if not backbone + head:
            return None  # of a network that was fitted in closed form to its buffers
        where = f"model.{self.kind}.fit"
        optimizer, scheduler = make_optimizer(where, self.fit_config, backbone, head)
        return {
            "optimizer": optimizer,
            "lr_scheduler": {"scheduler": scheduler, "interval": "step"},
        }

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Make room for the statistics that a finished training has added."""
        self.classifier.expect_statistics(own_state(checkpoint))

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Keep the cost of the weights beside them, and the validation loss that chose them.

        With them by sense the novelties of training recordings that its features do not know: no
        layer before the scores was trained, and each was left out of the statistics.
        """
        checkpoint["fit_seconds"] = self.fit_seconds
        checkpoint["val_loss"] = self.val_loss
        checkpoint[LEFT_OUT] = self.left_out


def accuracy(classes: int) -> MulticlassAccuracy:
    """Make the share of correct predictions."""
    return MulticlassAccuracy(classes, average="micro", validate_args=False)


def vote_metrics(classes: int, stage: str) -> MetricCollection:
    """Make the metrics of whole samples, see :func:`update_metrics`.

    ``fragment_accuracy`` and ``vote_accuracy`` are shares of all fragments and of all samples,
    ``ece`` is the expected calibration error of the probability of the class that won (lower is
    better), and ``auroc`` the area under the ROC curve of all class probabilities, each class
    against the rest and pooled: unlike the mean over classes it exists where one has no sample.

    Args:
        classes: Their number.
        stage: ``val`` or ``test``; the names begin with it. Testing counts confusions as well.
    """
    metrics: dict[str, Metric | MetricCollection] = {
        "fragment_accuracy": accuracy(classes),
        "vote_accuracy": accuracy(classes),
        "ece": BinaryCalibrationError(BINS, validate_args=False),
        "auroc": BinaryAUROC(thresholds=THRESHOLDS, validate_args=False),
    }
    if stage == "test":
        metrics[CONFUSION] = MulticlassConfusionMatrix(classes, validate_args=False)
    return MetricCollection(metrics, prefix=f"{stage}/", compute_groups=False)


def update_metrics(metrics: MetricCollection, vote: Vote, label: Tensor) -> None:
    """Add the vote on a sample of class ``label`` () to :func:`vote_metrics`."""
    # a mean probability may be rounded to more than 1, which torchmetrics would take for a logit
    probabilities = vote.probabilities.clamp(max=1).float().to(label.device)
    fragments = vote.fragments.to(label.device)
    winner = torch.full_like(label, vote.label)[None]
    correct = (label == vote.label).long()[None]
    one_hot = nn.functional.one_hot(label, len(probabilities))
    metrics["fragment_accuracy"].update(fragments, label.expand_as(fragments))
    metrics["vote_accuracy"].update(winner, label[None])
    metrics["ece"].update(probabilities[vote.label][None], correct)
    metrics["auroc"].update(probabilities, one_hot)
    if CONFUSION in metrics:
        metrics[CONFUSION].update(winner, label[None])


def training_layout(classifier: nn.Module) -> torch.memory_format:
    """Return the layout to train networks in: channels last, the faster one, if they are built in.

    In it oneDNN of PyTorch 2.13 ends the process in the gradient of a convolution of kernel 1 and
    stride 2 on eight channels, which no network of this package has.
    """
    return torch.channels_last if is_builtin(classifier) else torch.contiguous_format


def make_optimizer(
    where: str, fit: dict[str, Any], backbone: list[nn.Parameter], head: list[nn.Parameter]
) -> tuple[Any, LRScheduler]:
    """Make a recipe's optimiser of two groups of parameters, and its schedule.

    Args:
        where: The recipe's key.
        fit: The recipe.
        backbone: Parameters at the base learning rate.
        head: Parameters at ``head_factor`` times that.

    Raises:
        UserError: If one of the two cannot be made, or is none.
    """
    rate = fit["learning_rate"]
    groups = [
        {"params": backbone, "lr": rate, "name": "backbone"},
        {"params": head, "lr": rate * fit["head_factor"], "name": "head"},
    ]
    groups = [group for group in groups if group["params"]]
    steps = max(1, fit["epochs"] * fit["steps_per_epoch"])
    optimizer = call(f"{where}.optimizer", build(f"{where}.optimizer", fit["optimizer"]), groups)
    make_scheduler = build(
        f"{where}.schedule", fit["schedule"],
        total_steps=steps, total_iters=steps, T_max=steps,
        max_lr=[group["lr"] for group in groups],
    )  # fmt: skip
    scheduler = call(f"{where}.schedule", make_scheduler, optimizer)
    if isinstance(scheduler, ReduceLROnPlateau) or not isinstance(scheduler, LRScheduler):
        raise UserError(
            f"{where}.schedule is {type(scheduler).__name__}, which does not go by the number "
            "of the step; choose a class that does, such as torch.optim.lr_scheduler.StepLR."
        )
    return optimizer, scheduler
