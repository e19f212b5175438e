"""Final figures and hyper-parameters in TensorBoard, beside the curves of training."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from torch.utils.tensorboard import SummaryWriter

from tex_lightning.schema import flatten
from tex_lightning.stability.trial import Trial

HPARAM_TYPES = (bool, int, float, str)


def log_test(
    directory: Path,
    name: str,
    config: dict[str, Any],
    result: dict[str, Any],
    figures: Any,  # noqa: ANN401
) -> None:
    """Add test accuracies, figures and the hyper-parameters that led to them.

    Args:
        directory: The run folder; events go to ``tensorboard/NAME``.
        name: haptic, visual or fusion.
        config: The whole configuration as plain values.
        result: The network's entry of ``results.json``.
        figures: Matplotlib figures by title.
    """
    metrics = {
        "test/fragment_accuracy": result["fragment_accuracy"],
        "test/vote_accuracy": result["vote_accuracy"],
        "test/latency_ms": result["latency_ms"]["median"],
        "test/fit_seconds": result["fit_seconds"],
    }
    with SummaryWriter(str(directory / "tensorboard" / name)) as writer:
        for title, figure in figures.items():
            writer.add_figure(f"test/{title}", figure)
        for title, value in metrics.items():
            writer.add_scalar(title, value)
        writer.add_hparams(_hyper_parameters(config, name), metrics, run_name=".")


def log_profile(
    directory: Path, name: str, result: dict[str, Any], figures: dict[str, Any]
) -> None:
    """Add a network's profile: every single figure as a scalar, and its charts."""
    with SummaryWriter(str(directory / "tensorboard" / name)) as writer:
        for title, figure in figures.items():
            writer.add_figure(f"profile/{title}", figure)
        for key, value in result.items():
            if isinstance(value, int | float):
                writer.add_scalar(f"profile/{key}", value)


def log_stability(directory: Path, trials: Sequence[Trial], figures: dict[str, Any]) -> None:
    """Add vote accuracies over severity, as a curve for each system, and the charts."""
    with SummaryWriter(str(directory / "tensorboard" / "stability")) as writer:
        for title, figure in figures.items():
            writer.add_figure(f"stability/{title}", figure)
    for system in dict.fromkeys(trial.system.name for trial in trials):
        with SummaryWriter(str(directory / "tensorboard" / system)) as writer:
            for trial in trials:
                if trial.system.name == system:
                    title = f"{trial.perturbation.modality}/{trial.perturbation.name}"
                    writer.add_scalar(title, trial.accuracy, int(trial.severity))


def _hyper_parameters(config: dict[str, Any], name: str) -> dict[str, Any]:
    """Flat plain values of what this network was trained with."""
    chosen = {"seed": config["seed"], "data": config["data"], name: config["model"][name]}
    return {key: value for key, value in flatten(chosen).items() if isinstance(value, HPARAM_TYPES)}
