"""Lightning's progress bar as this package shows it."""

from typing import Any

from lightning.pytorch.callbacks import RichProgressBar

from tex_lightning.learning.base import REFRESH


class ProgressBar(RichProgressBar):
    """Lightning's bar on standard error, without the number of the log version."""

    def __init__(self) -> None:
        super().__init__(refresh_rate=REFRESH, console_kwargs={"stderr": True})

    def get_metrics(self, *args: Any) -> dict[str, int | str | float | dict[str, float]]:  # noqa: ANN401
        """The metrics beside the bar."""
        metrics = super().get_metrics(*args)
        metrics.pop("v_num", None)
        return metrics
