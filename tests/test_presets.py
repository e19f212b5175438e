"""Presets compose, and the rows of tables and frontiers exist."""

import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from tex_lightning.config import CONF, register, variants
from tex_lightning.config.user_folders import config_groups
from tex_lightning.perturbations.table import trainable
from tex_lightning.report.table import paper_tables

EXPERIMENTS = config_groups()["experiment"]
MODELS = {*config_groups()["model"]}


def composed(*overrides: str):
    register()
    with initialize_config_dir(str(CONF), version_base="1.3"):
        return compose("config", overrides=list(overrides), return_hydra_config=True)


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_experiment_composes_and_its_rows_exist(experiment):
    config = composed(f"experiment={experiment}")
    rows = (OmegaConf.select(config, "hydra.sweeper.params.model") or "").split(",")
    assert set(filter(None, rows)) <= MODELS
    if "table" in experiment and rows != [""]:
        assert config.task == "crossval"
        assert config.data.val_fold is None
        assert config.hydra.mode.name == "MULTIRUN"


@pytest.mark.slow
@pytest.mark.parametrize("family", ["haptic", "visual", "sound", "fusion"])
def test_every_system_of_a_frontier_composes(family):
    systems = OmegaConf.load(CONF / "frontier" / f"{family}.yaml").systems
    assert len(systems) >= 7
    for overrides in systems.values():
        assert composed(*overrides.split()).model.name in MODELS


def test_subsets_of_senses_are_of_the_model_that_is_asked_for():
    for given, model in (((), "fusion_sum"), (("model=fusion",), "fusion")):
        config = composed("task=frontier", "frontier=senses", *given)
        assert (config.frontier.senses, config.model.name) == (["haptic", "visual"], model)


def test_all_of_the_papers_rows_are_swept():
    swept = set(composed("experiment=paper/all").hydra.sweeper.params.model.split(","))
    for table in ("haptic", "visual", "fusion", "kylberg", "kth_tips2b"):
        for row in paper_tables()[table]["rows"]:
            if "vote" in row or "fragment" in row:
                assert row["model"] in swept, row


def test_the_best_fusion_stands_on_the_best_parts():
    haptic, visual, fusion = (
        composed(f"experiment=best/{name}") for name in ("haptic", "visual", "fusion")
    )
    few = composed("experiment=few/haptic")
    assert (haptic.model, haptic.decision) == (few.model, few.decision)
    assert fusion.model.haptic == haptic.model.haptic
    assert fusion.model.visual == visual.model.visual


def test_band_proportions_go_by_one_name_and_stand_in_their_tables():
    presets = {name: composed(f"experiment={name}") for name in ("few/haptic", "best/haptic")}
    named = composed("model=band_proportions")
    for each in presets.values():
        assert (each.model, each.decision) == (named.model, named.decision)
    sound = composed("experiment=few/sound")
    assert (sound.model.name, sound.decision.rule) == ("band_proportions", "score")
    assert sound.model.sound.features == sound.model.haptic.features
    swept = composed("experiment=table/haptic").hydra.sweeper
    assert named.model.name in swept.params.model.split(",")
    for family in ("haptic", "sound", "fusion"):
        assert named.model.name in composed(f"frontier={family}").frontier.systems
    assert composed("experiment=few/fusion").model.name == "fusion_band_proportions"


# Table "allParams": learning rate, gamma, k and batch size; the last is the size of a sub-sample
PAPER = {
    "haptic": (1e-4, 0.3, 40_000, 10, 300),
    "visual": (3e-5, 0.75, 40_000, 2, 384),
    "fusion": (1e-6, 0.1, 4_000_000, 1, None),
}


@pytest.mark.parametrize("preset", ["haptic", "visual_tcnn", "fusion_fc2", "all"])
def test_presets_hold_the_papers_table_of_hyper_parameters(preset):
    model = composed(f"experiment=paper/{preset}").model
    for kind in PAPER if preset == "all" else [preset.partition("_")[0]]:
        fit = model[kind].fit
        size, schedule = fit.get("frames", fit.get("patch")), fit.schedule
        numbers = (fit.learning_rate, schedule.gamma, schedule.step_size, fit.batch_size, size)
        assert numbers == PAPER[kind]
        assert fit.epochs * fit.steps_per_epoch == 100_000
        assert (fit.optimizer._target_, fit.optimizer.weight_decay) == ("torch.optim.Adam", 5e-4)
        assert schedule._target_ == "torch.optim.lr_scheduler.StepLR"


@pytest.mark.parametrize("preset", ["haptic", "visual", "fusion"])
def test_robust_presets_train_on_what_is_not_held_out(preset):
    config = composed(f"experiment=robust/{preset}")
    plain = composed(f"model={config.model.name}")
    assert {*config.model.haptic.fit.perturb} < {*trainable("haptic")}
    assert {*config.model.visual.fit.perturb} < {*trainable("image")}
    assert plain.model.haptic.fit.perturb == plain.model.visual.fit.perturb == []


def test_options_of_a_few_lines_are_no_files_and_a_users_file_begins_with_them(tmp_path):
    names = [*variants()]
    assert len(names) > 30
    assert not [name for name in names if (CONF / f"{name}.yaml").exists()]
    (tmp_path / "model").mkdir()
    text = "defaults: [fusion_tcnn, _self_]\nname: mine\nfusion: {level: fc3}\n"
    (tmp_path / "model" / "mine.yaml").write_text(text)
    mine = composed("model=mine", f"hydra.searchpath=[file://{tmp_path}]").model
    assert mine == {**composed("model=fusion_fc3_tcnn").model, "name": "mine"}
