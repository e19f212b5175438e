"""Check what a training is made of before it starts: settings, weights and a user's classes."""

from collections.abc import Sequence
from pathlib import Path

from torch import Tensor

from tex_lightning.baselines.classifier import BaselineClassifier
from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.contract_check import BATCH, check_baseline, check_parts
from tex_lightning.config import Config
from tex_lightning.config.instantiation import PACKAGE
from tex_lightning.config.model import FUSION
from tex_lightning.core.run_folder import checkpoint_of, find_checkpoint
from tex_lightning.data.recordings import Recordings
from tex_lightning.data.store import Store
from tex_lightning.errors import UserError
from tex_lightning.learning.loggers import open_loggers
from tex_lightning.learning.module import SurfaceModule, make_module
from tex_lightning.learning.start import start_trunk
from tex_lightning.learning.trainer import build_callbacks, make_trainer, quiet_lightning
from tex_lightning.networks.blocks import is_builtin
from tex_lightning.senses.base import Sense


def check_training(config: Config, card: Card, directory: Path) -> list[Sense]:
    """Make all parts of a training once, so that errors are raised before it starts.

    Returns:
        The senses of the model, with random weights.

    Raises:
        UserError: Naming the key that does not fit.
    """
    model, sources = config.model, config.sources
    loggers = open_loggers(config.logger, directory, card.kind)
    if model.baseline is not None:
        classifier = BaselineClassifier(card)
        for source in sources.values():
            classifier.baseline.load_weights(source)
        return [*classifier.senses.values()]
    callbacks, fit = build_callbacks(config.callbacks, config.trainer.flags), model.fit_values
    working = checkpoint_of(directory, card.kind).with_suffix("")
    with quiet_lightning():
        make_trainer(config.trainer, callbacks, loggers, fit(card.kind), working, validated=True)
    senses = [_try_sense(config, card.of([name]), sources.get(name)) for name in card.sense_names]
    if card.kind == FUSION:
        make_module(config, card).configure_optimizers()
    return senses


def _try_sense(config: Config, card: Card, source: str | None) -> Sense:
    """Make one sense as it will be trained, or load it from its given checkpoint."""
    name, model = card.kind, config.model
    if name in model.checkpoints:
        file = find_checkpoint(model.checkpoints[name])
        return SurfaceClassifier.from_checkpoint(file, name).senses[name]
    module = make_module(config, card)
    module.configure_optimizers()
    if source is not None:
        start_trunk(module.classifier, source)
    sense, fit = module.classifier.eval().senses[name], model.sense(name).fit
    least = sense.known_min_size if is_builtin(sense.features) else None
    if least is not None and fit.piece < least[1]:
        raise UserError(
            f"model.{name}.fit.{fit.piece_key} is {fit.piece}, and this network needs {least[1]} "
            f"for a prediction; choose {least[1]} or more."
        )
    return sense


def check_custom_parts(
    config: Config, card: Card, senses: Sequence[Sense], recordings: Recordings, store: Store
) -> None:
    """Check the contracts of senses that have parts of a user's."""
    model = config.model
    for sense in senses if model.baseline is None else ():
        name, augmentation = sense.name, model.fit_values(sense.name).get("augmentation")
        builtin = sense.is_builtin and augmentation is None
        if not builtin and name not in model.checkpoints:
            check_sense(make_module(config, card.of([name])), recordings, store)


def check_sense(module: SurfaceModule, recordings: Recordings, store: Store) -> None:
    """Check one sense: train it on two recordings, save it and load it again."""
    classifier, piece = module.classifier, module.piece_sizes[module.kind]
    rebuilt, fit = _rebuilt(classifier), module.fit_config
    check_parts(classifier, rebuilt, fit, piece, recordings, store, module.augment)


def check_fitted_baseline(classifier: BaselineClassifier, recordings: Sequence[Tensor]) -> None:
    """Check the outputs of a user's fitted baseline, and that its state restores them."""
    if type(classifier.baseline).__module__.startswith(PACKAGE):
        return
    check_baseline(classifier, _rebuilt(classifier), recordings[:BATCH])


def _rebuilt(classifier: SurfaceClassifier) -> SurfaceClassifier:
    """Return a new classifier, built from the card of another."""
    return type(classifier)(Card.from_dict(classifier.card.to_dict()))
