"""What TensorBoard shows of runs, read by its own reader."""

import io
import json
import shutil
import wave

import numpy as np
import pytest
from event_files import START, count, runs, trials, words
from google.protobuf import text_format
from PIL import Image
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.plugins.projector.projector_config_pb2 import ProjectorConfig

from tex_lightning.evaluation.outcomes import Outcome, read_outcomes
from tex_lightning.report.gallery import figure_artifacts
from tex_lightning.studies.network_results import draw_figures


def test_runs_sort_as_they_are_read_and_no_chart_is_called_epoch(fused):
    found = runs(fused)
    assert list(found) == ["tensorboard/1-haptic", "tensorboard/2-visual", "tensorboard/5-fusion"]
    for events in found.values():
        scalars = events.Tags()["scalars"]
        assert {"train/loss", "val/loss", "test/vote_accuracy"} <= {*scalars}
        assert "epoch" not in scalars
        assert len(events.Scalars("test/vote_accuracy")) == 1


def test_trials_have_what_was_chosen_and_no_bookkeeping(fused, surfaces):
    found = trials(fused)
    assert [values.pop("network") for values in found.values()] == ["haptic", "visual", "fusion"]
    for values in found.values():
        assert values == {
            "model": "fusion", "data": "folder", "data.root": str(surfaces), "debug": "tiny",
            "data.half_scale": "false", "trainer.threads": 1,
        }  # fmt: skip


def test_what_a_sweep_varies_is_in_columns_and_names(swept):
    found = trials(swept)
    assert [values["data.test_fold"] for values in found.values()] == [0, 1]
    assert [*found] == [f"{n}/tensorboard/1-haptic test_fold={n}" for n in (0, 1)]
    assert all("experiment" not in events.summary_metadata for events in runs(swept).values())
    assert count(swept, "_hparams_/experiment") == 0  # which would hide the columns of other runs


def test_what_decides_between_trials_comes_first_among_columns(fused):
    entry = json.loads((fused / "results.json").read_text())["networks"]["haptic"]
    events = runs(fused)["tensorboard/1-haptic"]
    first = sorted(events.Tags()["scalars"])[:4]  # as TensorBoard's table has them
    assert all(name.startswith("Trial/") for name in first)
    values = [scalar.value for name in first for scalar in events.Scalars(name)]
    expected = [entry["val_loss"], entry["vote_accuracy"], *entry["vote_ci95"]]
    assert values == pytest.approx(expected)


def test_folds_are_parts_of_one_trial(crossvalidated):
    assert [*trials(crossvalidated)] == ["tensorboard/1-haptic"]
    found = runs(crossvalidated)
    assert [*found] == [f"{home}tensorboard/1-haptic" for home in ("folds/0/", "folds/3/", "")]
    for events in found.values():
        assert len(events.Scalars("test/vote_accuracy")) == 1


def test_an_evaluation_is_no_trial_and_again_leaves_one_result(cli, fused, surfaces, tmp_path):
    for _ in range(2):
        outcome = cli(
            "task=evaluate", f"checkpoint={fused}/checkpoints/haptic.ckpt", "data=folder",
            f"data.root={surfaces}", f"hydra.run.dir={tmp_path}",
        )  # fmt: skip
        assert outcome.status == 0, outcome.err
    assert trials(tmp_path) == {}
    (events,) = runs(tmp_path).values()
    assert len(events.Scalars("test/vote_accuracy")) == 1
    assert count(tmp_path, "confusion/recordings") == 1


def test_a_run_that_goes_on_has_no_second_trial(cli, tiny, run_once, tmp_path):
    run = shutil.copytree(run_once("model=haptic", *tiny), tmp_path / "run")
    (run / "results.json").unlink()  # as if it had been stopped while it was testing
    assert cli("model=haptic", *tiny, f"hydra.run.dir={run}").status == 0
    assert count(run, START) == 1
    (events,) = runs(run).values()
    assert len(events.Scalars("test/vote_accuracy")) == 1


def test_texts_say_command_data_and_results(fused):
    events = runs(fused)["tensorboard/5-fusion"]
    command, data, results = (words(events, tag) for tag in ("1 command", "2 data", "3 results"))
    assert "python -m tex_lightning model=fusion data=folder" in command
    traces = "30 files; 2.4 s each, 72 in all; 10 of a class"
    for said in ("3: alpha, beta, gamma", traces, "10,000 Hz", "fold 0 is"):
        assert said in data
    assert "|  | haptic | visual | fusion |" in results
    assert "| correct | " in results


def test_figures_of_the_run_folder_are_shown_as_they_are(fused):
    for name in ("haptic", "visual", "fusion"):
        (events,) = (found for key, found in runs(fused).items() if key.endswith(name))
        for tag, figure in (
            ("confusion/recordings", "confusion"), ("confusion/fragments", "confusion_fragments"),
            ("histogram/fragment accuracy by class", "classes"),
        ):  # fmt: skip
            (image,) = events.Images(tag)
            file = fused / "figures" / f"{name}_{figure}.png"
            assert image.encoded_image_string == file.read_bytes()
        assert not any("reliability" in tag for tag in events.Tags()["images"])  # of three samples


def test_inputs_are_shown_before_and_after_augmentation(fused):
    found = runs(fused)["tensorboard/5-fusion"]
    tags = [tag for tag in found.Tags()["images"] if tag.startswith("inputs/")]
    assert sorted(tags) == [
        f"inputs/{kind}, {when} augmentation"
        for kind in ("haptic spectrograms", "visual photos")
        for when in ("1 before", "2 after")
    ]
    pictures = [decoded(found, tag) for tag in sorted(tags)]
    assert all(picture.std() > 10 for picture in pictures)  # they are no blanks
    assert pictures[2].shape == pictures[3].shape
    turned = np.abs(pictures[2].astype(int) - pictures[3]).mean()
    assert turned > 10  # photos of the same places are turned


def decoded(events: EventAccumulator, tag: str) -> np.ndarray:
    (image,) = events.Images(tag)
    return np.asarray(Image.open(io.BytesIO(image.encoded_image_string)).convert("RGB"))


def test_the_projector_has_label_and_thumbnail_of_each_recording(fused):
    home = fused / "tensorboard" / "5-fusion"
    config = text_format.Parse((home / "projector_config.pbtxt").read_text(), ProjectorConfig())
    assert [each.tensor_name for each in config.embeddings] == ["haptic", "visual"]
    for each in config.embeddings:
        vectors = np.loadtxt(home / each.tensor_path, delimiter="\t")
        heading, *lines = (home / each.metadata_path).read_text().splitlines()
        assert heading.split("\t") == ["label", "predicted", "part", "file"]
        cells = [line.split("\t") for line in lines]
        assert len(cells) == len(vectors) == 27  # 24 trained on, 3 tested
        assert sorted({(row[0], row[2]) for row in cells if row[2] == "test"}) == [
            (label, "test") for label in ("alpha", "beta", "gamma")
        ]
        side = each.sprite.single_image_dim[0]
        with Image.open(home / each.sprite.image_path) as sprite:
            assert sprite.size == (6 * side, 6 * side)


def test_embeddings_tell_classes_apart_that_the_network_tells_apart(bands):
    (home,) = (bands / "tensorboard").iterdir()
    name = next((home / "projector").iterdir())
    vectors = np.loadtxt(name / "tensors.tsv", delimiter="\t")
    lines = [line.split("\t") for line in (name / "metadata.tsv").read_text().splitlines()[1:]]
    labels, parts = (np.array([line[column] for line in lines]) for column in (0, 2))
    trained, kinds = parts == "training", sorted({*labels})
    centres = np.stack([vectors[trained & (labels == kind)].mean(axis=0) for kind in kinds])
    distances = np.linalg.norm(vectors[~trained, None] - centres, axis=2)
    assert [kinds[nearest] for nearest in distances.argmin(axis=1)] == [*labels[~trained]]


def test_errors_and_confused_pairs_can_be_seen_and_heard(run_once, tiny, fused):
    run = run_once("model=haptic", *tiny, "model.haptic.fit.score_shrinkage=null")
    errors = [
        each for each in read_outcomes(run / "predictions" / "haptic.csv")
        if each.label != each.predicted
    ]  # fmt: skip
    assert errors, "the smallest training makes none"
    events = runs(run)["tensorboard/1-haptic"]
    images, audio = events.Tags()["images"], events.Tags()["audio"]
    shown = [tag for tag in images if tag.startswith("worst samples/")]
    for each in errors:
        assert any(f"{each.label} (" in tag and f"called {each.predicted}" in tag for tag in shown)
    pairs = [tag for tag in images if tag.startswith("confused pairs/")]
    assert {(each.label, each.predicted) for each in errors} & {
        tuple(sides_of(tag)) for tag in pairs
    }
    for tag in pairs:
        assert [f"{tag}: haptic of {side}" for side in sides_of(tag)] == [
            heard for heard in audio if heard.startswith(f"{tag}:")
        ]
    (sound,) = events.Audio(audio[0])
    with wave.open(io.BytesIO(sound.encoded_audio_string)) as opened:
        assert opened.getframerate() == 10_000
        assert opened.getnframes() == 24_000  # the whole trace
    assert runs(fused)["tensorboard/2-visual"].Tags()["audio"] == []


def test_a_crossvalidation_shows_samples_of_all_its_folds(crossvalidated):
    outcomes = read_outcomes(crossvalidated / "predictions" / "haptic.csv")
    tags = runs(crossvalidated)["tensorboard/1-haptic"].Tags()
    errors = [each for each in outcomes if each.label != each.predicted]
    shown = [tag for tag in tags["images"] if tag.startswith("worst samples/")]
    assert len(shown) == max(3, len(errors))
    assert sum(" called " in tag for tag in shown) == len(errors)
    assert len(tags["audio"]) >= 2


def sides_of(tag: str) -> list[str]:
    return tag.partition("/")[2].partition(" ")[2].split(" called ")


def test_the_first_command_leaves_events_of_some_megabytes(fused):
    files = (file for file in (fused / "tensorboard").rglob("*") if file.is_file())
    assert sum(file.stat().st_size for file in files) < 5e6


@pytest.mark.parametrize("count", [49, 50])
def test_calibration_is_shown_of_fifty_samples(count, tmp_path):
    known = json.dumps({"a": 0.75, "b": 0.25})
    outcomes = [
        Outcome({"haptic": str(n)}, "ab"[n % 2], "a", 1, 1, 1, 1.0, '{"a": 1}', 1.0, known)
        for n in range(count)
    ]
    draw_figures(outcomes, ["a", "b"], "haptic", tmp_path)
    tags = [picture.tag for picture in figure_artifacts(tmp_path, "haptic")]
    assert ("reliability/recordings" in tags) == (count == 50)
    assert "confusion/fragments" in tags
