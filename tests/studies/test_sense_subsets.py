"""Systems of every subset of senses."""

from pathlib import Path

import pytest
from omegaconf import OmegaConf

from tex_lightning.config.composition import Job
from tex_lightning.config.weights import read_config
from tex_lightning.studies.sense_subsets import with_subsets


@pytest.mark.parametrize(
    ("given", "model"),
    [
        (["model=auto"], "fusion_sum"),
        (["experiment=few/fusion"], "fusion_efficientnet"),
        (["experiment=few/fusion", "model=fusion"], "fusion"),
    ],
)
def test_subsets_are_asked_at_once_and_one_sense_after_another(given, model):
    asked = ("frontier=senses", *given, "frontier.senses=[haptic,sound]")
    job = Job(asked, Path(), "command", True, (), OmegaConf.create())
    family = with_subsets(read_config(job.compose(asked)), job)
    assert family.systems == {
        "haptic": f"model={model} model.senses=[haptic]",
        "sound": f"model={model} model.senses=[sound]",
        "haptic+sound": f"model={model} model.senses=[haptic,sound]",
        "haptic+sound_sequential": f"model={model} model.senses=[haptic,sound] decision=sequential",
    }
