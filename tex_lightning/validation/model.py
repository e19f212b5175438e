"""What is asked of ``model``."""

from collections.abc import Iterator

from tex_lightning.baselines.registry import BASELINES
from tex_lightning.learning.callbacks.fusion import LEAST_FACTOR, MOST_FACTOR
from tex_lightning.perturbations.augment import trainable
from tex_lightning.schema import FitConfig, ModelConfig
from tex_lightning.validation.ranges import choice, least, positive, within

CHOICES = {
    "optimizer": ("adam", "adamw"),
    "schedule": ("onecycle", "step"),
    "norm": ("batch", "lrn", "none"),
    "normalisation": ("standard", "paper"),
    "axes": ("frame", "trace"),
    "scale": ("mel", "linear"),
    "level": ("fc2", "fc3"),
    "head_start": ("scores", "random"),
}


def check_model(model: ModelConfig) -> Iterator[str]:
    """What cannot be meant of ``model``."""
    yield from choice("model.kind", model.kind, ("haptic", "visual", "fusion"))
    yield from positive("model.budget", model.budget)
    if model.baseline is None:
        if model.settings:
            yield "model.settings belong to a baseline, and this model has none: leave them out"
    else:
        yield from choice("model.baseline", model.baseline, tuple(BASELINES))
    yield from choice("model.haptic.norm", model.haptic.norm, CHOICES["norm"])
    yield from choice("model.visual.norm", model.visual.norm, CHOICES["norm"])
    known = CHOICES["normalisation"]
    yield from choice("model.haptic.normalisation", model.haptic.normalisation, known)
    yield from choice("model.haptic.axes", model.haptic.axes, CHOICES["axes"])
    yield from choice("model.haptic.scale", model.haptic.scale, CHOICES["scale"])
    yield from choice("model.fusion.level", model.fusion.level, CHOICES["level"])
    starts = CHOICES["head_start"]
    yield from choice("model.fusion.head_start", model.fusion.head_start, starts)
    probe = model.visual.fit.probe
    yield from least("model.visual.fit.probe.steps", probe.steps, 0)
    yield from least("model.visual.fit.probe.passes", probe.passes, 1)
    yield from least("model.visual.fit.probe.batch_size", probe.batch_size, 1)
    yield from positive("model.visual.fit.probe.learning_rate", probe.learning_rate)
    yield from positive("model.visual.fit.probe.strength", probe.strength)
    yield from least("model.visual.fit.probe.side", probe.side, 224)
    for name in ("haptic", "visual"):
        section = getattr(model, name)
        yield from positive(f"model.{name}.width", section.width)
        if not 0 <= section.dropout < 1:
            yield f"model.{name}.dropout is {section.dropout}: choose from 0 up to 1"
    head = list(model.visual.head)
    if len(head) not in (0, 2) or min(head, default=1) < 1:
        yield f"model.visual.head is {head}: give channels of FC1 and FC2, or [] for neither"
    yield from least("model.haptic.fit.frames", model.haptic.fit.frames, 177)
    for name in ("visual", "fusion"):
        rotation = getattr(model, name).fit.rotation
        if not 0 <= rotation <= 180:
            yield f"model.{name}.fit.rotation is {rotation}: choose from 0 to 180 degrees"
    for name in model.haptic.fit.perturb:
        yield from choice("model.haptic.fit.perturb", name, trainable("haptic"))
    yield from least("model.haptic.fit.perturbed_copies", model.haptic.fit.perturbed_copies, 1)
    for name in model.visual.fit.perturb:
        yield from choice("model.visual.fit.perturb", name, trainable("image"))
    share = model.visual.fit.perturbed_share
    yield from within("model.visual.fit.perturbed_share", share, 0, 1)
    dropped = model.fusion.fit.modality_dropout
    yield from within("model.fusion.fit.modality_dropout", dropped, 0, 1)
    summed = model.fusion.head_start == "scores"
    # without an epoch, VisualNet's fitted head and FusionNet's sum are all there is
    epochs = {"haptic": 1, "visual": 1 if head else 0, "fusion": 0 if summed else 1}
    for name, fewest in epochs.items():
        fit = getattr(model, name).fit
        yield from least(f"model.{name}.fit.epochs", fit.epochs, fewest)
        yield from _fit(f"model.{name}.fit", fit)
    factor = model.fusion.fit.head_factor
    if model.kind == "fusion" and not LEAST_FACTOR <= factor <= MOST_FACTOR:
        yield (
            f"model.fusion.fit.head_factor is {factor:g}: choose from {LEAST_FACTOR:g} to "
            f"{MOST_FACTOR:g}"
        )


def _fit(key: str, fit: FitConfig) -> Iterator[str]:
    for name in ("steps_per_epoch", "batch_size", "step_every"):
        yield from least(f"{key}.{name}", getattr(fit, name), 1)
    for name in ("learning_rate", "gamma", "head_factor"):
        yield from positive(f"{key}.{name}", getattr(fit, name))
    yield from least(f"{key}.weight_decay", fit.weight_decay, 0)
    if not 0 <= fit.label_smoothing < 1:
        yield f"{key}.label_smoothing is {fit.label_smoothing}: choose from 0 up to 1"
    yield from choice(f"{key}.optimizer", fit.optimizer, CHOICES["optimizer"])
    yield from choice(f"{key}.schedule", fit.schedule, CHOICES["schedule"])
