"""Parts that a user might bring, named by ``_target_`` as ``own_parts.NAME``."""

from typing import Any

import torch
from hydra.experimental.callback import Callback as HydraCallback
from lightning import Callback
from lightning.pytorch.loggers import Logger
from lightning.pytorch.loggers.logger import rank_zero_experiment


class MemoryLogger(Logger):
    """Keeps what it is given of every network, in memory."""

    kept: dict[str, "MemoryLogger"] = {}  # noqa: RUF012

    def __init__(self, run_name: str):
        super().__init__()
        self.metrics, self.params, self.images = {}, {}, {}
        self.kept[run_name] = self

    @property
    def name(self) -> str:
        return "memory"

    @property
    def version(self) -> int:
        return 0

    @property
    @rank_zero_experiment
    def experiment(self) -> None:
        return None

    def log_metrics(self, metrics: dict[str, float], step: int | None = None) -> None:
        for name, value in metrics.items():
            self.metrics.setdefault(name, []).append(value)

    def log_hyperparams(self, params: Any, *args: Any, **kwargs: Any) -> None:
        self.params.update(params)

    def log_image(self, key: str, images: list[Any]) -> None:
        self.images[key] = images


class NothingOfLightning:
    """Neither a logger nor a callback."""


class EpochCounter(Callback):
    """Counts the epochs of all trainings."""

    epochs = 0

    def on_train_epoch_end(self, *_: Any) -> None:
        EpochCounter.epochs += 1


def halved_at_the_end(optimizer: torch.optim.Optimizer, total_steps: int) -> Any:
    """A schedule that is no class."""
    return torch.optim.lr_scheduler.LambdaLR(
        optimizer, lambda step: 1.0 if step < total_steps else 0.5
    )


class JobReturns(HydraCallback):
    """Keeps what the jobs of a sweep return."""

    values: list[Any] = []  # noqa: RUF012

    def on_job_end(self, config: Any, job_return: Any, **_: Any) -> None:
        self.values.append(job_return.return_value)
