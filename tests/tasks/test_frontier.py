"""A small family, its charts and the choice, through the command line."""

import csv
import json

import pytest
from hydra import initialize_config_dir
from PIL import Image

from tex_lightning.config import CONF, register
from tex_lightning.runs.family import with_system
from tex_lightning.tasks import frontier

CONTRACT = (
    "system", "kind", "parameters", "macs", "latency_ms_median", "latency_ms_p95", "fit_seconds",
    "vote_accuracy", "ci_low", "ci_high", "on_frontier", "chosen",
)  # fmt: skip


@pytest.fixture(scope="module")
def given(surfaces):
    return "data=folder", f"data.root={surfaces}", "debug=tiny"


@pytest.fixture(scope="module")
def measured(run_once, given):
    return run_once(
        "task=frontier", *given, "crossval.only=[0]",
        "frontier.only=[hapticnet_w0.125,hapticnet_w0.5,hapticnet_w0.5_bf16,"
        "hapticnet_w0.5_sequential,minirocket]",
    )  # fmt: skip


def test_table_has_the_columns_and_one_choice(measured):
    with (measured / "frontier.csv").open() as stream:
        reader = csv.DictReader(stream)
        assert reader.fieldnames[: len(CONTRACT)] == list(CONTRACT)
        rows = list(reader)
    assert len(rows) == 5
    assert [row["system"] for row in rows if row["chosen"] == "True"] == ["minirocket"]
    latencies = [float(row["latency_ms_median"]) for row in rows]
    assert latencies == sorted(latencies)


def test_validation_recordings_take_no_part_in_training(measured):
    folder = measured / "systems" / "minirocket" / "0"
    with (folder / "validation.csv").open() as stream:
        held = {line["haptic"] for line in csv.DictReader(stream)}
    assert {path[-5] for path in held} == {"5"}  # NAME_5.wav: half the folds away from fold 0
    entry = json.loads((folder / "measured.json").read_text())
    assert entry["test_samples"] == 3


def test_sequential_decision_counts_the_arithmetic_that_was_done(measured):
    with (measured / "frontier.csv").open() as stream:
        macs = {row["system"]: row["macs"] for row in csv.DictReader(stream)}
    outcomes = measured / "systems/hapticnet_w0.5_sequential/0/predictions/haptic.csv"
    with outcomes.open() as stream:
        evidence = [float(row["evidence"]) for row in csv.DictReader(stream)]
    done = int(macs["hapticnet_w0.5_sequential"]) / int(macs["hapticnet_w0.5"])
    assert done == pytest.approx(sum(evidence) / len(evidence), rel=1e-4)
    assert macs["minirocket"] == ""


def test_charts_can_be_opened(measured):
    with Image.open(measured / "frontier.png") as image:
        assert min(image.size) > 300
    page = (measured / "frontier.html").read_text()
    assert "minirocket" in page
    assert 'src="http' not in page  # self-contained


def test_networks_that_differ_in_precision_are_trained_once(measured):
    assert len(list((measured / "networks").iterdir())) == 2


def test_every_system_is_timed_on_photos_of_its_own_size(given, cli, monkeypatch):
    sides = {}

    def classify(classifier, samples):
        _, photo = next(samples)
        sides[classifier.card.decode["half_scale"]] = photo.shape[0]

    monkeypatch.setattr(frontier, "_classify_next", classify)
    systems = "frontier.only=[visualnet_squeezenet,visualnet_squeezenet_half]"
    only = "crossval.only=[0]", "data.half_scale=false"
    assert cli("task=frontier", "frontier=fusion", *given, *only, systems).status == 0
    assert sides[False] == 2 * sides[True]


def test_auto_trains_the_chosen_system(measured, given, cli, tmp_path):
    outcome = cli("model=auto", f"frontier.run={measured}", *given, f"hydra.run.dir={tmp_path}/r")
    assert outcome.status == 0, outcome.err
    assert json.loads((tmp_path / "r/results.json").read_text())["model"] == "minirocket"


def test_auto_goes_on_with_the_choice_that_it_made(given, cli, tmp_path, monkeypatch):
    def measure_again(*_: object) -> None:
        raise AssertionError("the family was measured a second time")

    monkeypatch.setattr(frontier, "run", measure_again)
    made = tmp_path / "r" / "frontier" / "results.json"
    made.parent.mkdir(parents=True)
    made.write_text(json.dumps({"overrides": ["model=minirocket"]}))
    outcome = cli("model=auto", "data.val_fold=2", *given, f"hydra.run.dir={tmp_path}/r")
    assert outcome.status == 0, outcome.err
    assert json.loads((tmp_path / "r/results.json").read_text())["model"] == "minirocket"


def test_one_source_of_weights_is_for_networks_on_photos():
    register()
    given = ["weights=imagenet", "seed=3"]
    with initialize_config_dir(str(CONF), version_base="1.3"):
        assert with_system(given, ["model=haptic"]) == ["seed=3", "model=haptic"]
        assert with_system(given, ["model=minirocket"]) == ["seed=3", "model=minirocket"]
        for model in ("model=visual_squeezenet", "model=fusion_squeezenet"):
            assert with_system(given, [model]) == [*given, model]


def test_budget_is_answered_with_a_command(measured, given, cli):
    outcome = cli(
        "task=frontier", *given, "crossval.only=[0]", f"hydra.run.dir={measured}",
        "frontier.only=[minirocket]", "frontier.min_accuracy=0.9",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    assert "python -m tex_lightning model=minirocket" in outcome.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["task=frontier", "frontier.only=[nothing]"], "does not have"),
        (["model=auto", "task=crossval"], "use task=fit"),
        (["model=auto", "frontier.run=nowhere"], "no finished frontier"),
        (["frontier.max_latency_ms=5"], "task=frontier alone"),
    ],
)
def test_what_cannot_be_meant_is_refused(arguments, message, given, cli, tmp_path):
    outcome = cli(*arguments, *given, f"hydra.run.dir={tmp_path}/r")
    assert outcome.status == 2
    assert message in outcome.err
