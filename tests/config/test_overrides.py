"""What counts as chosen by the user, in every form that Hydra reads."""

import pytest
from omegaconf import OmegaConf

from tex_lightning.config.overrides import chosen_settings, swept_keys


@pytest.mark.parametrize(
    ("override", "settings"),
    [
        ("seed=3", {"seed": 3}),
        ("model.haptic.fit.learning_rate=1e-3", {"model.haptic.fit.learning_rate": 1e-3}),
        ("+sense@model.force=mine", {"sense@model.force": "mine"}),
        ("++model.haptic.fit={epochs: 3, more: {a: [1, x]}}",
         {"model.haptic.fit.epochs": 3, "model.haptic.fit.more.a": '[1, "x"]'}),
        ("data.val_fold=null", {"data.val_fold": "null"}),
        ("data.hold_out=[oak,pine]", {"data.hold_out": "[oak,pine]"}),
        ('data.root="/a b/1e3"', {"data.root": "/a b/1e3"}),
        ("~callbacks.progress", {"callbacks.progress": "removed"}),
        *((each, {}) for each in ("logger=mlflow", "~logger.csv", "+logger.mine.a=1", "verbose=0",
          "data.cache_dir=/tmp/a", "hydra/job_logging=none", "trusted=[mine]")),
    ],
)  # fmt: skip
def test_an_override_is_a_setting_or_bookkeeping(override, settings):
    assert chosen_settings([override]) == settings


def test_what_is_swept_is_a_setting_whatever_it_is():
    assert chosen_settings(["verbose=0"], ["verbose"]) == {"verbose": 0}


def test_keys_that_a_sweep_varies_come_from_command_and_file(tmp_path, monkeypatch):
    job = tmp_path / "sweep" / "deep" / "0"
    (job / ".hydra").mkdir(parents=True)
    given = ["model=haptic", "seed=1,2", "+model.haptic.width=range(1,3)", "data.hold_out=[a,b]"]
    whole = {"hydra": {"overrides": {"task": given}}}
    OmegaConf.save(whole, tmp_path / "sweep" / "multirun.yaml")
    hydra = {"mode": "MULTIRUN", "sweeper": {"params": {"trunk": "tcnn,vgg_m"}}}
    OmegaConf.save({"hydra": hydra}, job / ".hydra" / "hydra.yaml")
    assert swept_keys(job) == ["seed", "model.haptic.width", "trunk"]
    (tmp_path / "sweep" / "multirun.yaml").unlink()  # as Optuna leaves none
    monkeypatch.setattr("sys.argv", ["tex_lightning", "-m", "seed=interval(1,2)", "model=haptic"])
    assert swept_keys(job) == ["seed", "trunk"]
    monkeypatch.setattr("sys.argv", ["worker", "--pipe=3", "a=(("])  # of a launcher
    assert swept_keys(job) == ["trunk"]
    OmegaConf.save({"hydra": {**hydra, "mode": "RUN"}}, job / ".hydra" / "hydra.yaml")
    assert swept_keys(job) == swept_keys(tmp_path) == []
