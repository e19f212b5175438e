"""Pictures of why, through the command line and Python."""

import json

import pytest
import soundfile
from conftest import RATE, make_photo, make_trace
from PIL import Image

import tex_lightning as tl
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import read_outcomes


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    for number in range(2):
        soundfile.write(folder / f"s{number}.wav", make_trace(0, number), RATE, subtype="FLOAT")
        Image.fromarray(make_photo(1, number)).save(folder / f"s{number}.png")
    return folder


def without_latency(line: str) -> dict[str, object]:
    return {key: value for key, value in json.loads(line).items() if key != "latency_ms"}


def test_the_label_printed_is_the_one_drawn(cli, untrained, files, tmp_path):
    given = [
        "task=predict", f"checkpoint={untrained}", f"haptic={files}/s0.wav",
        f"image={files}/s0.png", "decision.reject_below=0.99",
    ]  # fmt: skip
    plain = cli(*given)
    figure = tmp_path / "new" / "w.PNG"
    drawn = cli(*given, f"predict.figure={figure}")
    assert drawn.status == 0, drawn.err
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert without_latency(drawn.out) == {**without_latency(plain.out), "figure": str(figure)}
    assert json.loads(drawn.out)["rejected"] is True


def test_a_sequential_decision_is_drawn_in_full(cli, untrained, files, tmp_path):
    given = ["task=predict", f"checkpoint={untrained}/checkpoints/visual.ckpt"]
    given += [f"image={files}/s0.png", f"predict.figure={tmp_path}/w.png"]
    full, sequential = (cli(*given, *more).out for more in ([], ["decision=sequential"]))
    assert without_latency(sequential) == without_latency(full)


def test_a_baseline_is_refused_in_one_sentence(cli, naive_bayes, files, tmp_path):
    given = ["task=predict", f"checkpoint={naive_bayes}", f"haptic={files}/s0.wav"]
    outcome = cli(*given, f"predict.figure={tmp_path}/w.png")
    assert outcome.status == 2
    (line,) = outcome.err.splitlines()
    assert "mfcc_nb looks at the whole recording at once" in line
    with pytest.raises(UserError, match="so it has no map to draw"):
        tl.load(naive_bayes).explain(haptic=files / "s0.wav")


def test_a_part_of_a_fusion_and_equal_cuts_are_drawn(untrained, bands, files, tmp_path):
    part = tl.load(untrained).explain(image=files / "s0.png")
    assert list(part.senses) == ["visual"]
    assert part.prediction.label == tl.load(untrained).predict(image=files / "s0.png").label
    cuts = tl.load(bands).explain(haptic=files / "s0.wav")
    evidence = cuts.senses["haptic"]
    assert evidence.columns[-1, 1] == evidence.seconds == 2.4
    cuts.save(tmp_path / "cuts.png")
    assert (tmp_path / "cuts.png").stat().st_size > 10_000


def test_a_run_draws_its_wrong_samples_or_the_least_sure(cli, bands, surfaces, tmp_path):
    outcomes = read_outcomes(bands / "predictions" / "haptic.csv")
    wrong = sum(each.label != each.predicted for each in outcomes)
    figures = sorted(path.name for path in (bands / "figures").glob("*why*.png"))
    assert figures == [f"haptic_why_{number}.png" for number in range(1, (wrong or 1) + 1)]
    events = [path.read_bytes() for path in (bands / "tensorboard").rglob("events*")]
    assert any(b"test/why_1" in each for each in events)
    given = ["task=evaluate", f"checkpoint={bands}", "data=folder", f"data.root={surfaces}"]
    outcome = cli(*given, "explained_samples=0", f"hydra.run.dir={tmp_path}")
    assert outcome.status == 0, outcome.err
    assert not [path for path in (tmp_path / "figures").iterdir() if "why" in path.name]
