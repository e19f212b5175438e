"""Files of a user's own sense, ``+NAME=FILE``, on the command line of all tasks that read files."""

import json
from pathlib import Path

import pytest
import soundfile
import torch
from conftest import RATE, make_card, make_trace

from tex_lightning.classifier.classifier import SurfaceClassifier


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory) -> Path:
    """A network on what a force sensor measures."""
    card = make_card("haptic", width=0.1, modality="force")
    state = SurfaceClassifier(card).state_dict()
    path = tmp_path_factory.mktemp("force") / "force.ckpt"
    content = {"hyper_parameters": {"card": card.to_dict()}}
    content["state_dict"] = {f"classifier.{key}": value for key, value in state.items()}
    torch.save(content, path)
    return path


@pytest.fixture
def stroke(tmp_path) -> Path:
    path = tmp_path / "a stroke (1).wav"  # a name that Hydra misreads
    soundfile.write(path, make_trace(0, 0, 5.0), RATE, subtype="FLOAT")
    return path


def test_it_is_predicted_from_and_streamed(cli, checkpoint, stroke):
    given = [f"checkpoint={checkpoint}", f"force={stroke}"]
    outcome = cli("task=predict", *given)
    assert outcome.status == 0, outcome.err
    outcome = cli("task=stream", *given, "stream.chunk=2.5")
    assert outcome.status == 0, outcome.err
    assert [json.loads(line)["time"] for line in outcome.out.splitlines()] == [2.5, 5.0]


def test_it_is_profiled(cli, checkpoint, stroke, tmp_path):
    given = [f"checkpoint={checkpoint}", f"+force={stroke}", f"hydra.run.dir={tmp_path}/run"]
    given[1] = f"force={stroke}"
    outcome = cli("task=profile", *given, "debug=tiny")
    assert outcome.status == 0, outcome.err
    results = json.loads((tmp_path / "run" / "results.json").read_text())
    assert results["networks"]["haptic"]["windows"] > 1


@pytest.mark.parametrize("task", ["predict", "stream", "profile", "record"])
def test_one_that_is_not_read_is_refused(cli, checkpoint, stroke, tmp_path, task):
    more = ["checkpoint=null", "record.label=a", f"record.out={tmp_path}/o"]
    given = more if task == "record" else [f"checkpoint={checkpoint}"]
    outcome = cli(f"task={task}", *given, f"+smell={stroke}", f"hydra.run.dir={tmp_path}/run")
    assert (outcome.status, outcome.err.count("\n")) == (2, 1)
    assert "smell" in outcome.err
    assert "There is no key" not in outcome.err


@pytest.mark.parametrize("typo", ["hatpic", "chekpoint", "verbos"])
def test_a_mistyped_key_is_no_sense(cli, checkpoint, typo):
    outcome = cli("task=predict", f"checkpoint={checkpoint}", f"{typo}=A.wav")
    assert (outcome.status, outcome.err.count("\n")) == (2, 1)
    assert f"There is no key {typo} (did you mean" in outcome.err


def test_other_tasks_have_no_such_key(cli, stroke, tmp_path):
    outcome = cli(f"+force={stroke}", f"hydra.run.dir={tmp_path}/run")
    assert (outcome.status, outcome.err.count("\n")) == (2, 1)
    assert "There is no key force" in outcome.err
    (tmp_path / "conf" / "sense").mkdir(parents=True)
    (tmp_path / "conf" / "sense" / "force.yaml").write_text("defaults: [haptic, _self_]\n")
    known = ["--config-dir", tmp_path / "conf", "force=A.wav", f"hydra.run.dir={tmp_path}/run"]
    assert "force=FILE is read by task=predict, task=profile" in cli(*known).err
