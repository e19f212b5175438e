"""Make the loggers of a network, and log its inputs and the results of its test."""

import logging
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lightning.pytorch.loggers import CSVLogger, Logger, TensorBoardLogger
from lightning.pytorch.utilities import rank_zero_only
from torch import Tensor, nn

from tex_lightning.config import flatten
from tex_lightning.config.instantiation import build_derived, find_callable
from tex_lightning.config.overrides import Setting, chosen_settings, swept_keys
from tex_lightning.core.ranks import is_rank_zero
from tex_lightning.data.banks import Bank, Indices, PhotoBank
from tex_lightning.data.datamodule import TrainingBatches
from tex_lightning.errors import reason
from tex_lightning.evaluation.metrics import logged_figures
from tex_lightning.learning.module import SurfaceModule
from tex_lightning.report.artifacts import (
    MAX_NAME,
    UNUSUAL,
    Artifact,
    Media,
    folder_name,
    jpeg,
    show,
    shows,
)
from tex_lightning.report.pictures import input_pixels, row_of
from tex_lightning.report.table import typed_overrides
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures

SHOWN = 8  # recordings of each sense, of different classes as far as there are
MAX_FRAMES = 600  # of a long signal
MAX_PIXELS = 300  # pixels along one of them
log = logging.getLogger(__name__)

Nodes = Mapping[str, Mapping[str, Any] | None]  # of the configuration, by the logger's name


class RunLogger(TensorBoardLogger):
    """Lightning's logger for TensorBoard without a chart of the epoch, which would come first.

    With ``log_graph`` it shows the graph of each network that takes steps or is fitted.
    """

    def log_metrics(self, metrics: Mapping[str, float], step: int | None = None) -> None:
        """Log what Lightning does, but for its count of epochs."""
        super().log_metrics({key: value for key, value in metrics.items() if key != "epoch"}, step)

    @rank_zero_only
    def log_graph(self, model: nn.Module, input_array: Tensor | None = None) -> None:
        """Log the graph of a network; if it cannot be traced, warn and go on."""
        if not self._log_graph or not isinstance(model, SurfaceModule):
            return
        modes = {part: part.training for part in model.modules()}
        model.eval()
        try:
            with warnings.catch_warnings(), torch.random.fork_rng():
                warnings.simplefilter("ignore")  # of tracing, which is for the eye alone
                self.experiment.add_graph(_Drawn(model), tuple(model.example_inputs()))
        except Exception as error:  # whatever PyTorch cannot trace, it says in as many ways
            log.warning("There is no graph of this network for TensorBoard: %s.", reason(error))
        finally:
            for part, training in modes.items():  # some of which differ from that of the whole
                part.training = training


class _Drawn(nn.Module):
    """The parts of a module that its graph shows; tracing the module would read all properties."""

    def __init__(self, module: SurfaceModule) -> None:
        super().__init__()
        senses = module.classifier.senses.items()
        self.networks = nn.ModuleDict({name: sense.network for name, sense in senses})
        self.fusion = module.classifier.fusion
        self.run = [module.forward]  # in a list, since it is no part

    def forward(self, *inputs: Tensor) -> Tensor:
        """Return class scores."""
        return self.run[0](*inputs)


def open_loggers(nodes: Nodes, directory: Path, name: str) -> list[Logger]:
    """Make the configured loggers of one network, for its training and its test.

    Where a class takes them, it gets the run folder as ``save_dir`` and the network's name as
    ``version`` and ``run_name``. A CSV goes beside that of an interrupted run.

    Raises:
        UserError: If one cannot be made.
    """
    return [
        _make(f"logger.{title}", node, directory, name)
        for title, node in nodes.items()
        if node is not None  # which leaves one out
    ]


def _make(where: str, node: Mapping[str, Any], directory: Path, name: str) -> Logger:
    offered, called = {"save_dir": str(directory), "run_name": name}, find_callable(where, node)
    shown = isinstance(called, type) and issubclass(called, TensorBoardLogger)
    version = event_folder(directory, name) if shown else name
    logger: Logger = build_derived(where, node, Logger, **offered, version=version)
    if isinstance(logger, CSVLogger) and (earlier := Path(logger.log_dir)).is_dir():
        count = len(list(earlier.parent.glob(f"{name}*")))  # it would write over that one
        again = f"{name}_resumed{count}"
        logger = build_derived(where, node, Logger, **offered, version=again)
    return logger


def event_folder(directory: Path, name: str) -> str:
    """Return the folder of a network's events, which TensorBoard shows as the name of a run.

    That of a job of a sweep has what the sweep varies, so that jobs are told apart.
    """
    keys = swept_keys(directory)
    settings = chosen_settings(typed_overrides(directory), keys) if keys else {}
    swept = {key: settings[key] for key in keys if key in settings}
    brief = [key.rpartition(".")[2] for key in swept]
    titles = brief if len({*brief}) == len(brief) else [*swept]
    values = [f"{it:.4g}" if isinstance(it, float) else str(it) for it in swept.values()]
    pairs = (f"{title}={value}" for title, value in zip(titles, values, strict=True))
    text = " ".join([folder_name(name), *pairs])
    return UNUSUAL.sub("_", text)[:MAX_NAME].strip()


def show_inputs(loggers: Sequence[Logger], module: SurfaceModule, batches: TrainingBatches) -> None:
    """Log pictures of the same training recordings before and after augmentation.

    Before, a signal is whole and a photo is cropped. After, both are as in a training batch. The
    random numbers of the training are not changed.
    """
    if not is_rank_zero() or not shows(loggers):
        return
    pictures = []
    with torch.random.fork_rng(), torch.no_grad():
        for name, (bank, labels) in batches.banks.items():
            pictures += _input_pictures(module, name, bank, labels)
    for logger in loggers:
        show(logger, "inputs", pictures)


def _input_pictures(module: SurfaceModule, name: str, bank: Bank, labels: Indices) -> list[Media]:
    sense, size = module.classifier.senses[name], module.piece_sizes[name]
    _, first = np.unique(labels, return_index=True)
    chosen = np.sort(first)[np.linspace(0, len(first) - 1, min(SHOWN, len(first))).astype(int)]
    if isinstance(bank, PhotoBank):
        kept = replace(bank, augmentation=None, rotation=0.0)  # at the same corners
        pieces = kept.cut(chosen, np.random.default_rng(module.seed))
        before = [*sense.training_input(_on(pieces, sense.device), size)]
    else:
        before = [bank.inputs[index][..., :MAX_FRAMES] for index in chosen.tolist()]
    pieces = bank.cut(chosen, np.random.default_rng(module.seed))
    after = [*sense.training_input(_on(pieces, sense.device), size, module.augment)]
    kind = "spectrograms" if isinstance(sense.features, SpectrogramFeatures) else "features"
    kind = "photos" if sense.medium == "photo" else kind
    captions = [module.classifier.card.classes[labels[index]] for index in chosen.tolist()]
    return [
        Media(
            f"inputs/{name} {kind}, {when} augmentation",  # which sort as they are read
            jpeg(row_of([input_pixels(x, sense.features, MAX_PIXELS) for x in inputs], captions)),
            ".jpg",
        )
        for when, inputs in (("1 before", before), ("2 after", after))
    ]


def _on(pieces: dict[str, Tensor], device: torch.device) -> dict[str, Tensor]:
    return {key: value.to(device) for key, value in pieces.items()}


def log_test(
    loggers: Sequence[Logger],
    name: str,
    config: dict[str, Any],
    result: dict[str, Any],
    artifacts: Sequence[Artifact] = (),
    trial: Mapping[str, Setting] | None = None,
) -> None:
    """Log the metrics and artifacts of a test, and the hyper-parameters of the network.

    A network that was trained on all recordings has no test; its training is logged.

    Args:
        loggers: Loggers of the network.
        name: Name of the network: its sense, or ``fusion``.
        config: The whole configuration as plain values, or what of it was read.
        result: The network's entry of ``results.json``.
        artifacts: Figures, texts and the like.
        trial: Settings by which TensorBoard compares this training with others; None for a fold
            of a cross-validation, and for an evaluation, which trains nothing.
    """
    metrics = logged_figures(result)
    if trial is not None:
        metrics |= _compared(result)
    for logger in loggers:
        if not isinstance(logger, TensorBoardLogger):
            logger.log_hyperparams(_hyper_parameters(config, name))
            logger.log_metrics(metrics=metrics, step=None)  # as Lightning calls it
        show(logger, "test", artifacts, metrics, trial)
        if not isinstance(logger, TensorBoardLogger):  # whose file is closed
            logger.finalize("success")


def trial_settings(directory: Path, model: str, data: str, network: str) -> dict[str, Setting]:
    """Return the settings by which TensorBoard compares trainings: those that the user chose."""
    chosen = chosen_settings(typed_overrides(directory), swept_keys(directory))
    return {"network": network, "model": model, "data": data, **chosen}


def _compared(result: Mapping[str, Any]) -> dict[str, float]:
    """Return validation loss, accuracy and interval under names that TensorBoard sorts first."""
    low, high = result.get("vote_ci95") or (None, None)  # of what was not tested
    columns = {
        "1 objective, val_loss": result.get("val_loss"),
        "2 test accuracy": result.get("vote_accuracy"),
        "3 its 95 % interval from": low,
        "4 its 95 % interval to": high,
    }
    return {f"Trial/{name}": value for name, value in columns.items() if value is not None}


def _hyper_parameters(config: dict[str, Any], name: str) -> dict[str, Any]:
    """Return flat plain values of what this network was trained with, or is tested on."""
    chosen = {"seed": config["seed"], "data": config["data"]}
    if "model" in config:
        chosen[name] = config["model"][name]
    return {key: value for key, value in flatten(chosen).items() if isinstance(value, Setting)}
