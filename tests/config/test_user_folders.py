"""Which senses of a user's folder are composed with every command."""

import shutil

import pytest
from omegaconf import OmegaConf

from tex_lightning.config import CONF
from tex_lightning.config.check import read_config
from tex_lightning.config.composition import current_job, run_composed
from tex_lightning.config.mistakes import check_choices
from tex_lightning.config.user_folders import use_config_dir, user_folders, with_own_senses
from tex_lightning.errors import UserError


@pytest.fixture
def given(tmp_path):
    """The override that names a folder with a sense, and a file that others begin with."""
    (tmp_path / "sense").mkdir()
    (tmp_path / "sense" / "shared.yaml").write_text("hop: 3\n")
    (tmp_path / "sense" / "force.yaml").write_text("defaults: [signal, shared, _self_]\n")
    return f"hydra.searchpath=[file://{tmp_path}]"


def test_senses_are_composed_once_and_no_file_that_they_begin_with(given, tmp_path):
    for name in ("base", "haptic"):  # a base for others, and a name of the package's
        (tmp_path / "sense" / f"{name}.yaml").write_text("defaults: [signal, _self_]\n")
    found = with_own_senses([given, "seed=1"])
    assert found == [given, "seed=1", "+sense@model.force=force"]
    assert with_own_senses(found) == found


def test_what_is_asked_for_is_composed_so_that_what_it_lacks_is_told(given):
    asked = [given, "model.senses=[shared]"]
    added = ["+sense@model.force=force", "+sense@model.shared=shared"]
    assert with_own_senses(asked) == [*asked, *added]


def test_a_search_path_that_is_not_there_is_a_mistake(tmp_path):
    with pytest.raises(UserError, match=r"^hydra\.searchpath names .*/none, which is no folder\.$"):
        with_own_senses([f"hydra.searchpath=[file://{tmp_path},file://{tmp_path}/none]"])
    assert with_own_senses(["hydra.searchpath=[pkg://some.conf]"])


def test_a_file_that_cannot_be_read_is_left_to_hydra(given, tmp_path):
    (tmp_path / "sense" / "broken.yaml").write_bytes(b"\xff\xfe\x00")
    assert "+sense@model.broken=broken" in with_own_senses([given])


@pytest.mark.parametrize("name", ["2d", "kraft_ü", "a b", "fusion", "name", "kind"])
def test_a_file_with_a_name_that_no_sense_can_have_is_told(given, tmp_path, name):
    (tmp_path / "sense" / f"{name}.yaml").write_text("defaults: [signal, _self_]\n")
    with pytest.raises(UserError, match=f"^.*/sense/{name}.yaml cannot be a sense, .*; rename it"):
        with_own_senses([given])


def test_names_with_dashes_are_composed_and_hidden_files_are_nobodys(given, tmp_path):
    for name in ("my-force", "._force", ".#force"):
        (tmp_path / "sense" / f"{name}.yaml").write_text("defaults: [signal, _self_]\n")
    composed = run_composed(lambda made: current_job(made, python=True).overrides, [given])
    assert composed == ()
    assert with_own_senses([given])[1:] == [
        "+sense@model.force=force",
        "+sense@model.my-force=my-force",
    ]


@pytest.fixture
def two(tmp_path):
    """A folder with an option of the package's name, and one with others."""
    for name in ("one/data/folder", "two/experiment/mix", "two/model/own"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / f"{name}.yaml").write_text("defaults: [base, _self_]\n")
    yield [f"--config-dir={tmp_path}/one", f"--config-dir={tmp_path}/two"]
    use_config_dir([])


def test_each_config_dir_is_read(two, tmp_path):
    assert use_config_dir([*two, "seed=1"]) == ["seed=1"]
    assert user_folders()[:2] == [tmp_path / "one", tmp_path / "two"]


def test_a_file_with_the_name_of_the_packages_is_not_passed_over_in_silence(cli, two, tmp_path):
    for given in (two, [f"hydra.searchpath=[file://{tmp_path}/one]"]):
        run = f"hydra.run.dir={tmp_path}/run"
        outcome = cli(*given, "data=folder", f"data.root={tmp_path}", run)
        assert outcome.status == 2
        assert "Error: data/folder.yaml of yours has the name of an option" in outcome.err
    (tmp_path / "two" / "model" / "haptic.yaml").write_text("defaults: [base, _self_]\n")
    assert "Error: model/haptic.yaml of yours has the name" in cli(*two, "model=haptic").err
    (tmp_path / "two" / "callbacks").mkdir()
    (tmp_path / "two" / "callbacks" / "default.yaml").write_text("mine: null\n")
    said = cli(*two, "model=mfcc_nb", "callbacks=[default]", "data.hold_out=[default]").err
    assert "Error: callbacks/default.yaml of yours has the name" in said


def test_a_copy_of_the_packages_folder_is_read_as_that(tmp_path):
    shutil.copytree(CONF, tmp_path / "conf")
    where, choices = [f"hydra.searchpath=[file://{tmp_path}/conf]"], {"data": "folder"}
    check_choices(choices, where)
    assert with_own_senses(where) == where
    (tmp_path / "conf" / "data" / "folder.yaml").write_text("root: null\n")
    with pytest.raises(UserError, match=r"data/folder\.yaml of yours"):
        check_choices(choices, where)


def test_options_of_the_package_are_near_those_of_a_folder(cli, two):
    said = cli(two[1], "experiment=few/hapti").err
    assert "experiment=few/hapti does not exist (did you mean few/haptic?)" in said
    assert "few/haptic" in cli(two[1], "experiment=mixx").err


def test_overrides_are_kept_as_they_were_typed_without_those_of_the_package(given, tmp_path):
    typed = ["model.force.hop=${..modality}", "seed=${data.folds}"]
    job = run_composed(current_job, [given, *typed, f"hydra.run.dir={tmp_path}/run"])
    assert job.overrides == (*typed,)


def test_a_primary_file_begins_with_the_packages(cli, tmp_path):
    given = [f"--config-dir={tmp_path}", "--config-name=mine", "--cfg=job"]
    (tmp_path / "mine.yaml").write_text("defaults: [config, _self_]\nseed: 17\n")
    assert "\nseed: 17\n" in cli(*given).out
    with pytest.raises(UserError, match=r"put defaults: \[config, _self_\] in front"):
        read_config(OmegaConf.create({"seed": 17}))
