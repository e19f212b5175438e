"""The command line: a line of JSON for each sample, sentences for the rest."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import soundfile
from conftest import RATE, make_photo, make_trace
from PIL import Image

from tex_lightning_runtime import runtime as module
from tex_lightning_runtime.__main__ import main

RUNTIME = Path(module.__file__).parents[1]


@pytest.fixture
def command(exported, monkeypatch, capfd):
    def run(*arguments, model=exported[1]):
        monkeypatch.setattr(sys, "argv", ["tex-runtime", str(model), *map(str, arguments)])
        try:
            status = main()
        except SystemExit as end:
            status = end.code
        said = capfd.readouterr()
        return status, [json.loads(line) for line in said.out.splitlines()], said.err

    return run


@pytest.fixture
def folder(tmp_path):
    for number in (2, 10):
        soundfile.write(tmp_path / f"s{number}.wav", make_trace(number % 3, 0), RATE)
        Image.fromarray(make_photo(number % 3, 0, 480)).save(tmp_path / f"s{number}.png")
    (tmp_path / "notes.md").write_text("words")
    return tmp_path


def test_a_sample_is_a_line(command, folder, runtime):
    given = {"haptic": str(folder / "s2.wav"), "image": str(folder / "s2.png")}
    status, (line,), _ = command(*(f"{name}={file}" for name, file in given.items()), "--top-k=1")
    assert status == 0
    assert line["label"] == runtime.predict(**given)["label"]
    assert [*line][:2] == ["haptic", "image"]
    assert len(line["top_k"]) == 1


def test_names_of_files_steer_no_terminal_and_keep_their_letters(folder, exported):
    names = folder / "Tür\x1b[31m\u202e.wav", folder / "a\x9b.wav"
    names[0].write_bytes((folder / "s2.wav").read_bytes())
    names[1].write_text("no sound")
    command = [sys.executable, "-m", "tex_lightning_runtime", str(exported[1])]
    ended = [
        subprocess.run(
            [*command, f"haptic={name}", f"image={folder / 's2.png'}"], capture_output=True,
            env={**os.environ, "PYTHONIOENCODING": "ascii", "PYTHONPATH": str(RUNTIME)},
        )
        for name in names
    ]  # fmt: skip
    said, failed = ended[0].stdout.decode(), ended[1].stderr.decode()
    assert said.strip().isprintable()
    assert "Tür\\u001b[31m\\u202e.wav" in said
    assert failed.strip().isprintable()
    assert "a\\u009b.wav" in failed


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "NAME=FILE"),
        (["haptic=nowhere.wav"], "nowhere.wav does not exist"),
        (["haptic=nowhere/*.wav"], "no file of a known type"),
        (["haptic=a.wav", "rate=8000"], "does not look at rate"),
        (["haptic=a.wav", "haptic=b.wav"], "each modality once"),
    ],
)
def test_mistakes_are_told_in_a_sentence(command, arguments, message):
    status, lines, told = command(*arguments)
    assert (status, lines) == (2, [])
    assert told.startswith("Error: ")
    assert told.count("\n") == 1
    assert message in told


def test_what_cannot_be_classified_does_not_stop_the_others(command, folder):
    soundfile.write(folder / "s1.wav", make_trace(0, 0)[:100], RATE)
    Image.fromarray(make_photo(0, 0, 480)).save(folder / "s1.png")
    status, lines, told = command(f"haptic={folder}/*.wav", f"image={folder}/*.png")
    assert status == 2
    assert [line["haptic"] for line in lines] == [str(folder / f"s{n}.wav") for n in (2, 10)]
    assert [line["image"] for line in lines] == [str(folder / f"s{n}.png") for n in (2, 10)]
    assert "s1.wav" in told


def test_a_recording_in_a_file_for_each_axis_is_one_sample(command, folder, runtime):
    for place in (2, 10):
        (folder / f"s{place}.wav").unlink()
    files = [folder / f"s_{axis}_2.txt" for axis in "XYZ"]
    axes = [make_trace(kind, 0) for kind in range(3)]
    for file, samples in zip(files, axes, strict=True):
        np.savetxt(file, samples)
    status, (line,), _ = command(f"haptic={folder}/*.txt", f"image={folder}/s2.png")
    assert (status, line["haptic"]) == (0, str(files[0]))
    expected = runtime.predict(haptic=np.stack(axes), image=folder / "s2.png")
    assert line["probabilities"] == expected["probabilities"]


ALONE = """
import sys
names = ("torch", "scipy", "pandas", "clevercsv", "tex_lightning", "lightning", "sklearn")
sys.modules.update(dict.fromkeys(names))  # None: not installed
sys.argv[1:] = {arguments}
from tex_lightning_runtime.__main__ import main
sys.exit(main())
"""


def test_it_needs_neither_pytorch_nor_scipy(folder, exported, runtime):
    soundfile.write(folder / "fast.wav", make_trace(1, 0, 8.0), 44_100)  # to be resampled
    given = {"haptic": str(folder / "fast.wav"), "image": str(folder / "s2.png")}
    arguments = [str(exported[1]), *(f"{name}={file}" for name, file in given.items())]
    code, variables = ALONE.format(arguments=arguments), {**os.environ, "PYTHONPATH": str(RUNTIME)}
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, env=variables)
    assert ended.returncode == 0, ended.stderr
    expected = runtime.predict(**given)
    assert json.loads(ended.stdout)["probabilities"] == pytest.approx(expected["probabilities"])


def test_nothing_heavy_is_imported_before_it_is_needed():
    code = "import sys, tex_lightning_runtime; print(*sys.modules)"
    names = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout
    heavy = {"torch", "scipy", "tex_lightning", "PIL", "soundfile", "onnxruntime", "numpy.random"}
    assert not heavy & set(names.split())
