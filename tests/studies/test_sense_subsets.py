"""Systems of every subset of senses, and the order in which their additions are shown."""

from pathlib import Path

import pytest
from omegaconf import OmegaConf

from tex_lightning.config.composition import Job
from tex_lightning.config.weights import read_config
from tex_lightning.report.frontier_chart import AddedSense
from tex_lightning.studies.sense_subsets import chain, with_subsets


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


def added(before: str, after: str) -> AddedSense:
    return AddedSense(before, after, "", "", 0.0, 1, 0, 0, 1.0)


def test_additions_lead_to_the_chosen_system_and_on_to_all_senses():
    latencies = {"haptic": 3.0, "visual": 2.0, "sound": 1.0}
    names = ["haptic", "visual", "sound"]
    steps = [
        added("visual", "haptic+visual"), added("sound", "visual+sound"),
        added("haptic+visual", "haptic+visual+sound"), added("sound", "haptic+sound"),
        added("visual+sound", "haptic+visual+sound"),
    ]  # fmt: skip
    assert chain(names, "haptic+visual", latencies, steps) == [steps[0], steps[2]]
    assert chain(names, "sound", latencies, steps) == [steps[1], steps[4]]
    assert chain(names, "haptic+visual_sequential", latencies, steps) == []
