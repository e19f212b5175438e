"""Pictures of why, through the command line and Python."""

import json

import pytest
import soundfile
from conftest import RATE, make_photo, make_trace
from PIL import Image

import tex_lightning as tl
from tex_lightning.errors import UserError


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    soundfile.write(folder / "s.wav", make_trace(0, 0), RATE, subtype="FLOAT")
    Image.fromarray(make_photo(1, 0)).save(folder / "s.png")
    return {"haptic": folder / "s.wav", "image": folder / "s.png"}


def test_the_label_printed_is_the_one_drawn(cli, untrained, files, tmp_path):
    figure = tmp_path / "new" / "w.PNG"
    given = ["task=predict", f"checkpoint={untrained}", "decision.reject_below=0.99"]
    given += [f"{name}={file}" for name, file in files.items()]
    drawn = cli(*given, f"predict.figure={figure}")
    assert drawn.status == 0, drawn.err
    assert figure.read_bytes().startswith(b"\x89PNG")
    plain, line = json.loads(cli(*given).out), json.loads(drawn.out)
    del plain["latency_ms"], line["latency_ms"]
    assert line == {**plain, "figure": str(figure)}
    assert line["rejected"] is True


def test_a_baseline_is_refused_in_one_sentence(cli, naive_bayes, files, tmp_path):
    given = ["task=predict", f"checkpoint={naive_bayes}", f"haptic={files['haptic']}"]
    outcome = cli(*given, f"predict.figure={tmp_path}/w.png")
    assert outcome.status == 2
    (line,) = outcome.err.splitlines()
    assert "mfcc_nb looks at the whole recording at once" in line
    with pytest.raises(UserError, match="so it has no map to draw"):
        tl.load(naive_bayes).explain(haptic=files["haptic"])


def test_equal_cuts_are_drawn(bands, files, tmp_path):
    cuts = tl.load(bands).explain(haptic=files["haptic"])
    evidence = cuts.senses["haptic"]
    assert evidence.columns[-1, 1] == evidence.seconds == 2.4
    cuts.save(tmp_path / "cuts.png")
    assert (tmp_path / "cuts.png").stat().st_size > 10_000
