"""What is asked of ``model`` beyond ranges and choices of single keys."""

from collections.abc import Iterator

from tex_lightning.config import ModelConfig
from tex_lightning.config.check_ranges import choice, least
from tex_lightning.errors import shorten
from tex_lightning.perturbations.augment import trainable


def check_model(model: ModelConfig) -> Iterator[str]:
    """What cannot be meant of ``model``."""
    nodes = {
        "model.baseline": model.baseline,
        "model.visual.fit.augmentation": model.visual.fit.augmentation,
    }
    for key, node in nodes.items():
        if not isinstance(node, dict | None):
            yield f"{key} is {shorten(node)}: give a class and arguments, {{_target_: a.b.Name}}"
    head = list(model.visual.head)
    if len(head) not in (0, 2):
        given = shorten(head)
        yield f"model.visual.head is {given}: give channels of FC1 and FC2, or [] for neither"
    for name in model.haptic.fit.perturb:
        yield from choice("model.haptic.fit.perturb", name, trainable("haptic"))
    for name in model.visual.fit.perturb:
        yield from choice("model.visual.fit.perturb", name, trainable("image"))
    summed = model.fusion.head_start == "scores"
    # without an epoch, VisualNet's fitted head and FusionNet's sum are all there is
    epochs = {"haptic": 1, "visual": 1 if head else 0, "fusion": 0 if summed else 1}
    for name, fewest in epochs.items():
        yield from least(f"model.{name}.fit.epochs", getattr(model, name).fit.epochs, fewest)
