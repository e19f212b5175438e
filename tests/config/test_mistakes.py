"""Errors of plug-ins of Hydra, which are all installed in these tests, and what they say."""

import errno
import re
import warnings
from importlib.metadata import requires

import pytest
from hydra.core.plugins import Plugins
from hydra.errors import MissingConfigException

from tex_lightning.config.composition import compose_config
from tex_lightning.config.mistakes import EXTRAS, explain, to_user_error


def absent(option: str) -> str:
    """The sentence for an option of which Hydra knows nothing."""
    return str(explain(MissingConfigException("Could not find it", option, ["basic"])))


@pytest.mark.parametrize("option", EXTRAS)
def test_the_extra_of_a_plug_in_is_named(option):
    group = "sweeper" if option == "optuna" else "launcher"
    said = absent(f"hydra/{group}/{option}")
    assert said.startswith(f"hydra/{group}={option} needs a plug-in that is not installed; run: ")
    extra = re.search(r"tex_lightning\[(.*)\]'$", said)[1]
    (plugin,) = {
        cls.__module__.partition(".")[2].partition(".")[0]
        for cls in Plugins.instance().discover()
        if option.partition("_")[0] in cls.__module__
    }
    assert any(
        line.startswith(plugin.replace("_", "-")) and f"extra == '{extra}'" in line
        for line in requires("tex_lightning")
    )


def test_a_slip_is_no_plug_in():
    said = "hydra/launcher=joblb does not exist; choose one of basic."
    assert absent("hydra/launcher/joblb") == said


def test_a_search_of_which_every_trial_failed_says_so():
    with warnings.catch_warnings(action="ignore"):
        import optuna
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    with pytest.raises(ValueError, match="No trials") as caught:
        _ = optuna.create_study().best_trial
    said = "No trial of this search succeeded; correct what the errors above say."
    assert str(to_user_error(caught.value, began=True)) == said


def test_what_cannot_be_printed_is_not_the_run_folder():
    full = OSError(errno.ENOSPC, "No space left on device")
    assert str(to_user_error(full, began=False)).startswith("The output cannot be written ([Errno")
    full.filename = "outputs"
    assert str(to_user_error(full, began=False)).startswith("The run folder cannot be made ([Errno")


def test_a_mapping_in_the_place_of_an_option_gives_values_to_its_keys():
    assert compose_config(["data={folds: 3}"]).data.folds == 3


def test_slips_of_hydras_own_are_told_with_their_remedy(cli, tmp_path):
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "mine.yaml").write_text("seed: 9\n")
    for given, said in (
        (["experiment=mine"], "In 'experiment/mine': .* begin this file with # @package _global_"),
        (["+experiment=few/haptic"], "experiment has an option already, give experiment=NAME with"),
        (
            ["model=1"],
            "model=1 cannot be used: an option is a name; choose one of acnn, .* by ~model",
        ),
        (["logger=[csv,2]"], "an option is a name; choose one of "),
        (["trainer=null"], "an option is a name; choose one of .* leave it out by ~trainer"),
        (["++crossval.only.x=1"], r"\(a key stands below a list or a value\); give other values"),
        (["++model.senses.a.b=1"], r"\(a key stands below a list or a value\); give other values"),
        (["--cfg=job", "--resolve", "seed=${oc.env:NOPE}"], "A value cannot be used: .*'NOPE' not"),
    ):
        outcome = cli(f"--config-dir={tmp_path}", *given)
        assert (outcome.status, outcome.err.count("\n")) == (2, 1)
        assert re.search(said, outcome.err)
