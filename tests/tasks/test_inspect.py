"""Data are looked at before anything is trained, whatever they are."""

import json
import shutil

import numpy as np
import pytest
import soundfile
from conftest import RATE, make_photo, make_trace
from PIL import Image


@pytest.fixture
def inspected(cli, tmp_path):
    def run(*arguments):
        outcome = cli("task=inspect", *arguments, f"hydra.run.dir={tmp_path}/run")
        assert outcome.status == 0, outcome.err
        results = json.loads((tmp_path / "run/results.json").read_text())
        return results, outcome.err, (tmp_path / "run/report.html").read_text()

    return run


def test_what_the_data_are_and_what_is_suspected(inspected, surfaces, tmp_path):
    root = shutil.copytree(surfaces, tmp_path / "surfaces")
    shutil.copy(root / "alpha/haptic/alpha_1.wav", root / "beta/haptic/copy.wav")
    soundfile.write(root / "gamma/haptic/z.wav", make_trace(2, 50)[:4000], RATE)
    (root / "gamma/image/broken.png").write_bytes(b"no picture")
    results, err, page = inspected("data=folder", f"data.root={root}", "data.half_scale=false")
    traces, photos = results["recordings"]["haptic"], results["recordings"]["image"]
    assert traces["of_class"] == {"alpha": 10, "beta": 11, "gamma": 11}
    assert (traces["shortest"], traces["longest"]) == (0.4, 2.4)
    assert (traces["rates"], traces["axes"], traces["assumed"]) == ([RATE, RATE], [1, 1], 0)
    assert traces["read"] == ["10,000 Hz by the header of the file"]
    assert (photos["files"], photos["groups"]) == (30, 30)
    assert photos["parts"] == {"train": [27, 27], "test": [3, 3]}
    assert [entry["path"] for entry in results["skipped"]] == [f"{root}/gamma/image/broken.png"]
    kinds = {found["kind"]: found for found in results["findings"]}
    kinds.pop("same picture", None)  # the stripes of the surfaces lie alike now and then
    assert {*kinds} == {"copies", "too small"}
    assert kinds["too small"]["text"].startswith("1 of 32 traces")
    for text in (err, page):
        assert "have the same content" in text
        assert "10,000 Hz by the header of the file" in text
    assert page.count("<img") == 2  # an example of each class, by sense
    assert "broken.png" in page


def test_one_class_of_photos_alone_and_recordings_of_no_known_sense(inspected, cli, tmp_path):
    (tmp_path / "only/alpha").mkdir(parents=True)
    for number in range(2):
        Image.fromarray(make_photo(0, number)).save(tmp_path / f"only/alpha/{number}.png")
    results, err, _ = inspected("data=folder", f"data.root={tmp_path}/only")
    assert results["classes"] == ["alpha"]
    assert [*results["recordings"]] == ["image"]
    assert "1 of 2" not in err
    np.save(tmp_path / "f.npy", np.zeros((200, 2)))
    (tmp_path / "table.csv").write_text(
        "label,modality,path,group\noak,force,f.npy,0\noak,mic,g.npy,0\n"
    )
    refused = cli("task=inspect", "data=manifest", f"data.manifest={tmp_path}/table.csv")
    assert refused.status == 2
    assert "No sense reads force, mic; give data of haptic, visual, sound" in refused.err
    assert "Rename mic to sound (folders, or the column modality)." in refused.err


def test_a_rate_that_nobody_gave_is_said_wherever_it_matters(cli, inspected, tmp_path):
    for label in ("a", "b"):
        (tmp_path / "npy" / label).mkdir(parents=True)
        for number in range(4):
            samples = np.random.default_rng(number).standard_normal(5000) + (label == "b")
            np.save(tmp_path / "npy" / label / f"{number}.npy", samples)
    given = ["data=folder", f"data.root={tmp_path}/npy"]
    results, err, _ = inspected(*given)
    assert results["recordings"]["haptic"]["assumed"] == 8
    said = "The rate of 8 of 8 traces is only assumed, 10,000 Hz"
    assert said in " ".join(err.split())
    short = cli("model=haptic", *given, f"hydra.run.dir={tmp_path}/fit")
    assert short.status == 2
    assert "Its rate of 10,000 Hz is only assumed: if it is another, give data.file_rate" in (
        " ".join(short.err.split())
    )
    short = cli("model=haptic", *given, "data.file_rate=9000", f"hydra.run.dir={tmp_path}/fit")
    assert short.status == 2
    assert "assumed" not in short.err
