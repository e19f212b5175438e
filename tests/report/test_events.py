"""What TensorBoard shows of runs, read by its own reader."""

import shutil

from event_files import START, count, runs, trials, words


def test_runs_sort_as_they_are_read_and_no_chart_is_called_epoch(fused):
    found = runs(fused)
    assert list(found) == ["tensorboard/1-haptic", "tensorboard/2-visual", "tensorboard/5-fusion"]
    for events in found.values():
        scalars = events.Tags()["scalars"]
        assert {"train/loss", "val/loss", "test/vote_accuracy", "objective/val_loss"} <= {*scalars}
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


def test_a_run_that_goes_on_has_no_second_trial(cli, tiny, fused, tmp_path):
    run = shutil.copytree(fused, tmp_path / "run")
    (run / "results.json").unlink()  # as if it had been stopped while it was testing
    assert cli("model=fusion", *tiny, f"hydra.run.dir={run}").status == 0
    assert count(run, START) == 3
    for name, events in runs(run).items():
        assert len(events.Scalars("test/vote_accuracy")) == 1, name


def test_texts_say_command_data_and_results(fused):
    events = runs(fused)["tensorboard/5-fusion"]
    command, data, results = (words(events, tag) for tag in ("1 command", "2 data", "3 results"))
    assert "python -m tex_lightning model=fusion data=folder" in command
    for said in ("3: alpha, beta, gamma", "30; 2.4 s; 10 of a class", "10,000 Hz", "fold 0 is"):
        assert said in data
    assert "|  | haptic | visual | fusion |" in results
    assert "| correct | " in results


def test_figures_of_the_run_folder_are_shown_as_they_are(fused):
    for name in ("haptic", "visual", "fusion"):
        (events,) = (found for key, found in runs(fused).items() if key.endswith(name))
        (image,) = events.Images("confusion/recordings")
        file = fused / "figures" / f"{name}_confusion.png"
        assert image.encoded_image_string == file.read_bytes()
