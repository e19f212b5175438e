"""Lightning's progress bar as this package shows it."""

from typing import Any, ClassVar

from lightning import Trainer
from lightning.pytorch.callbacks import RichProgressBar
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

from tex_lightning.learning.base import REFRESH


class ProgressBar(RichProgressBar):
    """Lightning's bar for 80 columns: epochs are counted from 1, the metrics are the main ones."""

    def __init__(self) -> None:
        super().__init__(refresh_rate=REFRESH, console_kwargs={"stderr": True})

    shown: ClassVar = {"train/loss": "loss", "val/loss": "val_loss", "val/vote_accuracy": "votes"}

    def get_metrics(self, *args: Any) -> dict[str, int | str | float | dict[str, float]]:  # noqa: ANN401
        """The metrics beside the bar."""
        metrics = super().get_metrics(*args)
        return {short: metrics[name] for name, short in self.shown.items() if name in metrics}

    def configure_columns(self, trainer: Trainer) -> list[Any]:
        """Epoch, bar, steps and time left; Lightning adds the metrics."""
        return [
            TextColumn("[progress.description]{task.description}"),
            BarColumn(bar_width=8),
            MofNCompleteColumn(),
            TimeRemainingColumn(compact=True),
        ]

    def _get_train_description(self, current_epoch: int) -> str:
        text = f"Epoch {current_epoch + 1}/{self.trainer.max_epochs}"
        return f"{text:<{len(self.validation_description)}}"  # so that the bars stay in line
