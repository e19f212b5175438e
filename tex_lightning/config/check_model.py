"""What is asked of ``model`` beyond ranges and choices of single keys."""

from collections.abc import Iterator

from tex_lightning.config import ModelConfig
from tex_lightning.config.check_ranges import choice, least
from tex_lightning.config.instantiation import find_class
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
    if not model.senses or len(set(model.senses)) < len(model.senses):
        yield f"model.senses is {shorten(model.senses)}: name one sense or several, each once"
    if model.baseline is not None and len(model.senses) > 1:
        yield f"model={model.name} looks at one sense: give one in model.senses"
    head = list(model.visual.head)
    if len(head) not in (0, 2):
        given = shorten(head)
        yield f"model.visual.head is {given}: give channels of FC1 and FC2, or [] for neither"
    for sense in model.known:
        branch = model.branch(sense)
        for name in branch.fit.perturb:
            yield from choice(f"model.{sense}.fit.perturb", name, trainable(branch.modality))
        if branch.fit.epochs == 0 and not (sense == "visual" and not head):
            # what is fitted to all recordings at once is all there is
            network = find_class(f"model.{sense}.network", branch.network)
            fewest = 0 if hasattr(network, "fit") else 1
            yield from least(f"model.{sense}.fit.epochs", branch.fit.epochs, fewest)
    # and FusionNet's sum
    fewest = 0 if model.fusion.head_start == "scores" else 1
    yield from least("model.fusion.fit.epochs", model.fusion.fit.epochs, fewest)
