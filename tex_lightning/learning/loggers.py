"""Metrics and hyper-parameters for all configured loggers."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lightning.pytorch.loggers import CSVLogger, Logger, TensorBoardLogger

from tex_lightning.config import flatten
from tex_lightning.config.instantiation import build_derived

HPARAM_TYPES = (bool, int, float, str)

Nodes = Mapping[str, Mapping[str, Any] | None]  # of the configuration, by the logger's name


def open_loggers(nodes: Nodes, directory: Path, name: str) -> list[Logger]:
    """Make the configured loggers of one network, for its training and its test.

    Args:
        nodes: ``logger`` of the configuration. Where a class takes them, it gets the run folder as
            ``save_dir`` and the name as ``version`` and ``run_name``.
        directory: The run folder.
        name: Name of the network. A CSV goes beside that of an interrupted run.

    Raises:
        UserError: If one cannot be made.
    """
    return [
        _make(f"logger.{title}", node, directory, name)
        for title, node in nodes.items()
        if node is not None  # which leaves one out
    ]


def _make(where: str, node: Mapping[str, Any], directory: Path, name: str) -> Logger:
    offered = {"save_dir": str(directory), "run_name": name}
    logger: Logger = build_derived(where, node, Logger, **offered, version=name)
    if isinstance(logger, CSVLogger) and (earlier := Path(logger.log_dir)).is_dir():
        count = len(list(earlier.parent.glob(f"{name}*")))  # it would write over that one
        again = f"{name}_resumed{count}"
        logger = build_derived(where, node, Logger, **offered, version=again)
    return logger


def log_test(
    loggers: Sequence[Logger], name: str, config: dict[str, Any], result: dict[str, Any]
) -> None:
    """Add the metrics of the test and the hyper-parameters that led to them.

    Args:
        loggers: Those of the network.
        name: Name of the network: its sense, or ``fusion``.
        config: The whole configuration as plain values, or what of it was read.
        result: The network's entry of ``results.json``.
    """
    metrics = {
        "test/fragment_accuracy": result["fragment_accuracy"],
        "test/vote_accuracy": result["vote_accuracy"],
        "test/latency_ms": result["latency_ms"]["median"],
        "test/fit_seconds": result["fit_seconds"],
        **{f"test/{key}": value for key, value in result["calibration"].items()},
    }
    parameters = _hyper_parameters(config, name)
    for logger in loggers:
        if isinstance(logger, TensorBoardLogger):
            logger.log_hyperparams(parameters, metrics)  # side by side in its HPARAMS
        else:
            logger.log_hyperparams(parameters)
            logger.log_metrics(metrics)
        logger.finalize("success")


def _hyper_parameters(config: dict[str, Any], name: str) -> dict[str, Any]:
    """Return flat plain values of what this network was trained with, or is tested on."""
    chosen = {"seed": config["seed"], "data": config["data"]}
    if "model" in config:
        chosen[name] = config["model"][name]
    return {key: value for key, value in flatten(chosen).items() if isinstance(value, HPARAM_TYPES)}
