"""One training: what it writes on the card, in which order its hooks run, and both doors to it."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from conftest import FEW
from lightning import Callback
from omegaconf import OmegaConf

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier.card import configured_card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config
from tex_lightning.config.check import read_config
from tex_lightning.config.composition import compose_config
from tex_lightning.core.run_folder import checkpoint_of
from tex_lightning.learning.finish import refit_scores
from tex_lightning.learning.provenance import complete_recipe
from tex_lightning.learning.train import Training, train_networks
from tex_lightning.studies.dataset import Dataset
from tex_lightning.studies.fold import open_training, train_model


def opened(run: Path, folder: Path) -> tuple[Config, Dataset]:
    """The configuration of a run, and its recordings opened anew, without what it would log."""
    overrides = OmegaConf.load(run / ".hydra" / "overrides.yaml")
    config = replace(read_config(compose_config(overrides)), logger={}, callbacks={})
    return config, open_training(config, folder)


def weights(classifier: SurfaceClassifier) -> dict[str, torch.Tensor]:
    return {name: value.clone() for name, value in classifier.state_dict().items()}


def same(one: dict[str, torch.Tensor], other: dict[str, torch.Tensor]) -> bool:
    return one.keys() == other.keys() and all(torch.equal(one[key], other[key]) for key in one)


def test_a_model_is_trained_without_a_run_folder_as_a_command_does(fused, tmp_path):
    found = train_model(*opened(fused, tmp_path), tmp_path)
    expected = load_classifier(checkpoint_of(fused, "fusion"))
    assert same(weights(found), weights(expected))
    apart = {"fit_seconds": 0.0}
    cards = [replace(x.card, training={**x.card.training, **apart}) for x in (found, expected)]
    assert cards[0] == cards[1]
    assert {path.name for path in tmp_path.iterdir()} == {"checkpoints"}
    names = {path.name for path in (tmp_path / "checkpoints").iterdir()}
    assert names == {"haptic.ckpt", "visual.ckpt", "fusion.ckpt"}


@pytest.mark.parametrize(
    "model",
    [pytest.param(FEW, marks=pytest.mark.slow), ("model=mfcc_nb",)],
    ids=["few/haptic", "mfcc_nb"],
)
def test_the_result_adds_nothing_to_the_recipe_but_calibration_and_training(
    run_once, tiny, model, tmp_path
):
    config, dataset = opened(run_once(*model, *tiny), tmp_path)
    parts = dataset.parts(config.data)
    crossval = {"correct": 1, "test_samples": 2}
    ((training, classifier),) = train_networks(
        config,
        dataset.classes,
        parts,
        dataset.store,
        tmp_path,
        crossvalidated={config.model.kind: crossval},
    )
    recipe, result = training.card, classifier.card
    assert (recipe.calibration, recipe.training) == ({}, {"crossval": crossval})
    assert len(recipe.trained_on["seen"]) == len([*parts.train, *parts.val])
    assert replace(result, calibration={}, training=recipe.training) == recipe
    assert result.training["crossval"] == recipe.training["crossval"]
    assert result.training["fit_seconds"] > 0
    assert result.training["val_loss"] >= 0
    assert load_classifier(training.checkpoint).card == result


def test_the_checkpoint_of_a_trunk_is_read_once(run_once, tiny, tmp_path, monkeypatch):
    run = run_once("model=haptic", *tiny)
    config, dataset = opened(run, tmp_path)
    source, reads = checkpoint_of(run, "haptic"), []
    read = SurfaceClassifier.from_checkpoint
    monkeypatch.setattr(
        SurfaceClassifier,
        "from_checkpoint",
        lambda path, kind: reads.append(path) or read(path, kind),
    )
    config = replace(config, weights=str(source))
    rest = dataset.classes, dataset.parts(config.data), dataset.store, tmp_path / "again"
    ((training, _),) = train_networks(config, *rest)
    assert reads == [source]
    assert training.card.trained_on["trunks"] == {"haptic": str(source)}


class Spy(Callback):
    """A user's callback that sees the network, and changes it once it is trained."""

    def __init__(self) -> None:
        self.seen: dict[str, dict[str, torch.Tensor]] = {}

    def setup(self, trainer, module, stage) -> None:
        self.seen["setup"] = weights(module.classifier)

    def on_fit_end(self, trainer, module) -> None:
        self.seen["end"] = weights(module.classifier)
        for buffer in module.classifier.network.buffers():
            if buffer.is_floating_point():
                buffer.mul_(2)


def test_the_first_weights_come_before_and_statistics_after_the_callbacks(bands, tmp_path):
    config, dataset = opened(bands, tmp_path)
    parts, rest = dataset.parts(config.data), (dataset.store, tmp_path / "as it is")
    ((training, plain),) = train_networks(config, dataset.classes, parts, *rest)
    spy = Spy()
    watched = replace(training, directory=tmp_path / "watched", watchers=[spy]).run()
    later = ("statistics.", "rows.")
    fitted = {key: x for key, x in weights(plain).items() if not key.startswith(later)}
    assert same(spy.seen["setup"], fitted)  # of a fit in closed form nothing is left to do
    assert same(spy.seen["end"], fitted)
    kept = load_classifier(Path(tmp_path, "watched", "checkpoints", "haptic.ckpt"))
    assert same(weights(kept), weights(watched))
    assert not same(weights(kept), weights(plain))
    row = parts.train.rows[0]
    recording = torch.from_numpy(dataset.store.load(row).copy())
    mean = watched.embedding("haptic", recording).mean(dim=1)
    rows, features = watched.trained_embeddings["haptic"]
    torch.testing.assert_close(features[rows.index(row)], mean)  # of the weights as changed


def training_of(run: Path, folder: Path, *watchers: Callback, **callbacks) -> Training:
    """The training of a run of one network, not begun."""
    config, dataset = opened(run, folder)
    config, parts = replace(config, callbacks=callbacks), dataset.parts(config.data)
    card = configured_card(config, dataset.classes)
    card = complete_recipe(config, card, parts, dataset.store, {}, {})
    return Training(config, card, parts, dataset.store, folder, watchers=watchers)


def test_fc3_of_a_trained_hapticnet_is_refitted_unless_a_key_says_otherwise(
    run_once, tiny, tmp_path
):
    run, classifiers = run_once("model=haptic", *tiny), []
    for shrinkage in (3.0, None):
        training = training_of(run, tmp_path / str(shrinkage))
        training.config.model.sense("haptic").fit.score_shrinkage = shrinkage
        classifiers.append(training.run())
    refitted, trained = classifiers
    assert same(weights(refitted), weights(load_classifier(checkpoint_of(run, "haptic"))))
    differ = [
        name for name, x in weights(trained).items() if not torch.equal(x, weights(refitted)[name])
    ]
    assert {name.rpartition(".")[0].rpartition(".")[2] for name in differ} == {"1"}
    assert all("head.scores" in name for name in differ)
    refit_scores(trained, 3.0)
    assert same(weights(trained), weights(refitted))


def test_what_takes_no_step_is_not_refitted(run_once, tiny, tmp_path):
    run = run_once("model=haptic", *tiny, "trainer.max_epochs=0")
    training = training_of(run, tmp_path)
    training.config.model.sense("haptic").fit.score_shrinkage = None
    expected = load_classifier(checkpoint_of(run, "haptic"))
    assert same(weights(training.run()), weights(expected))


class Stop(Callback):
    def on_train_epoch_start(self, trainer, module) -> None:
        if trainer.current_epoch == 1:
            raise KeyboardInterrupt


def test_what_is_resumed_is_not_started_again(run_once, tiny, tmp_path, monkeypatch):
    training, begun = training_of(run_once("model=haptic", *tiny), tmp_path, Stop()), []
    monkeypatch.setattr(
        "tex_lightning.learning.train.start_network", lambda module, *_: begun.append(module.kind)
    )
    with pytest.raises(KeyboardInterrupt):
        training.run()
    assert [*training.epochs_folder.iterdir()]
    assert not training.checkpoint.exists()
    replace(training, watchers=()).run()
    assert training.checkpoint.is_file()
    assert not training.epochs_folder.exists()
    assert begun == ["haptic"]


class Diary(Callback):
    def __init__(self) -> None:
        self.entries: list[str] = []

    def setup(self, trainer, module, stage) -> None:
        self.entries.append("first weights")

    def on_train_start(self, trainer, module) -> None:
        self.entries.append("steps")

    @contextmanager
    def hidden(self) -> Iterator[None]:
        self.entries.append("hidden")
        yield
        self.entries.append("shown")


def test_a_bar_of_the_users_hides_the_packages_while_steps_are_taken(
    run_once, tiny, tmp_path, monkeypatch
):
    """Features of a trunk may take minutes before, which are shown."""
    bar = {"_target_": "lightning.pytorch.callbacks.TQDMProgressBar", "refresh_rate": 0}
    diary = Diary()
    monkeypatch.setattr("tex_lightning.learning.trainer.hidden", diary.hidden)
    training_of(run_once("model=haptic", *tiny), tmp_path, diary, bar=bar).run()
    assert diary.entries == ["first weights", "hidden", "steps", "shown"]
