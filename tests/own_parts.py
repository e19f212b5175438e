"""Parts that a user might bring, named by ``_target_`` as ``own_parts.NAME``."""

from typing import Any

import torch
from lightning import Callback
from lightning.pytorch.loggers import Logger
from lightning.pytorch.loggers.logger import rank_zero_experiment
from torch import nn


class MemoryLogger(Logger):
    """Keeps what it is given of every network, in memory."""

    kept: dict[str, "MemoryLogger"] = {}  # noqa: RUF012

    def __init__(self, run_name: str):
        super().__init__()
        self.metrics, self.params = {}, {}
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

    def log_metrics(self, metrics: dict[str, float], step: int | None) -> None:
        for name, value in metrics.items():
            self.metrics.setdefault(name, []).append(value)

    def log_hyperparams(self, params: Any, *args: Any, **kwargs: Any) -> None:
        self.params.update(params)


class NothingOfLightning:
    """Neither a logger nor a callback."""


class EpochCounter(Callback):
    """Counts the epochs of all trainings."""

    epochs = 0

    def on_train_epoch_end(self, *_: Any) -> None:
        EpochCounter.epochs += 1


class Frames(nn.Module):
    """Means of ten samples (1, 1, frames), then what spoils them."""

    def __init__(self, spoil: str = "") -> None:
        super().__init__()
        self.spoil, self.mean = spoil, 0.0
        if spoil in ("buffer", "resized"):
            self.register_buffer("learnt", torch.zeros(()))
        if spoil == "parameter":
            self.gain = nn.Parameter(torch.ones(()))

    def learn(self, signals: Any) -> None:
        mean = torch.stack([signal.mean() for signal in signals]).mean()
        if self.spoil == "outside":
            self.mean = mean
        if self.spoil == "buffer":
            self.learnt.copy_(mean)
        if self.spoil == "resized":
            self.learnt = mean.repeat(2)

    def forward(self, signal: torch.Tensor) -> Any:
        frames = signal[:1].unfold(-1, 10, 10).mean(-1)[None] - self.mean
        return _spoilt(frames, self.spoil)


class Fitted(Frames):
    """The same with a scale that is fitted, or a wrong idea of what is normalised."""

    def fit(self, magnitudes: Any) -> None:
        pass

    def magnitudes(self, signal: torch.Tensor) -> torch.Tensor:
        frames = signal[0].unfold(-1, 10, 10).mean(-1)
        return frames[None, None] if self.spoil == "shape" else frames

    def normalise(self, magnitudes: torch.Tensor) -> torch.Tensor:
        return magnitudes

    def forward(self, signal: torch.Tensor) -> torch.Tensor:
        return self.normalise(self.magnitudes(signal)).view(1, 1, -1)


class Descent(torch.optim.SGD):
    """An optimiser that has to be told how far it goes."""

    def __init__(self, params: Any, lr: float) -> None:
        super().__init__(params, lr=lr)


class Bytes(nn.Module):
    """Patches as whole numbers, which are no longer in [0, 1]."""

    def forward(self, patches: torch.Tensor) -> torch.Tensor:
        return (255 * patches).byte()


class Slipping(torch.optim.SGD):
    """An optimiser that takes no step."""

    def step(self, closure: Any = None) -> Any:
        raise KeyError("boom of a user")


class FewArguments(Callback):
    """Has a method that forgets the module."""

    def on_train_epoch_end(self, trainer: Any) -> None:  # type: ignore[override]
        pass


class SeesBatches(Callback):
    """Leaves out the argument that Lightning leaves out where there is one loader of data."""

    def on_validation_batch_end(  # type: ignore[override]
        self, trainer: Any, pl_module: Any, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        pass


class TakesStage(Callback):
    """Takes the stage as Lightning gives it, by its name, and has no use for two methods."""

    on_train_start = None  # type: ignore[assignment]

    def setup(self, trainer: Any, pl_module: Any, *, stage: str) -> None:
        pass

    def teardown(self, trainer: Any, pl_module: Any, **_: Any) -> None:
        pass

    def on_predict_batch_end(  # type: ignore[override]
        self, trainer: Any, pl_module: Any, outputs: Any, batch: Any, batch_idx: int, loader: int
    ) -> None:
        pass


class Breaking(Callback):
    """Fails in the midst of a training."""

    def on_train_epoch_end(self, *_: Any) -> None:
        raise KeyError("boom of a user")


class SpoiltNet(nn.Module):
    """Scores of five frames, then what spoils them."""

    def __init__(self, classes: int, spoil: str = "", more: int = 0) -> None:
        super().__init__()
        self.spoil, self.steps = spoil, 0
        self.hidden = nn.Conv1d(1, 4, 5)
        self.score_layer = nn.Conv1d(4, classes + more, 1)

    def features(self, x: torch.Tensor, level: str) -> Any:
        hidden = self.hidden(x)
        if self.spoil == "later" and not hasattr(self, "scale"):
            self.scale = nn.Parameter(torch.ones(()))
        if level == "fc2" and self.spoil != "blind":
            return hidden
        self.steps += self.training
        scores = self.score_layer(hidden)
        return scores + self.steps if self.spoil == "outside" else _spoilt(scores, self.spoil)


def _spoilt(x: torch.Tensor, how: str) -> Any:
    if how == "raise":
        raise KeyError("boom of a user")
    changes = {
        "none": lambda: None, "list": lambda: [x], "array": lambda: x.detach().numpy(),
        "batch": lambda: x.repeat(3, 1, 1), "flat": lambda: x.mean(-1), "detached": x.detach,
        "nan": lambda: x * torch.nan, "swapped": lambda: x.mT, "complex": lambda: x + 0j,
        "empty": lambda: x[..., :0],
    }  # fmt: skip
    return changes[how]() if how in changes else x


class LazyNet(nn.Module):
    """Layers whose sizes the first input would tell."""

    def __init__(self, classes: int) -> None:
        super().__init__()
        self.score_layer = nn.LazyConv1d(classes, 1)

    def features(self, x: torch.Tensor, level: str) -> torch.Tensor:
        return self.score_layer(x)
