"""What counts as chosen by the user, in every form that Hydra reads."""

import numpy as np
import pytest
from omegaconf import OmegaConf

from tex_lightning.config.overrides import as_key_value, chosen_settings, swept_keys
from tex_lightning.errors import UserError


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


def test_values_of_numpy_are_plain_ones_and_objects_none():
    for value in (np.array(["a b", "1"]), ("a b", "1"), [np.str_("a b"), "1"]):
        assert as_key_value("data.hold_out", value) == 'data.hold_out=["a b","1"]'
    assert as_key_value("a.b", {"c": np.float32(0.5), "d": np.True_}) == "model.a.b={c:0.5,d:true}"
    with pytest.raises(UserError, match=r"seed is <object object at .*>; give text, numbers"):
        as_key_value("seed", [object()])
