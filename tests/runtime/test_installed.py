"""The distribution stands alone: installed where there is no PyTorch it says the same."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import soundfile
from conftest import RATE, make_photo, make_trace
from PIL import Image

RUNTIME = Path(__file__).parents[2] / "runtime"
LIMIT = 165e6  # bytes


@pytest.mark.slow
def test_installed_alone_it_predicts_the_same(exported, runtime, tmp_path):
    soundfile.write(tmp_path / "a.wav", make_trace(0, 0), RATE)
    Image.fromarray(make_photo(0, 0, 480)).save(tmp_path / "a.png")
    venv, python = tmp_path / "venv", tmp_path / "venv" / "bin" / "python"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", venv], check=True)
    pip = [sys.executable, "-m", "pip", "--python", python, "install"]
    subprocess.run([*pip, RUNTIME], check=True, env={**os.environ, "PYTHONDONTWRITEBYTECODE": ""})
    packages = next(venv.rglob("site-packages"))
    assert sum(file.stat().st_size for file in packages.rglob("*") if file.is_file()) < LIMIT
    assert not any(packages.glob("torch*"))
    files = {"haptic": str(tmp_path / "a.wav"), "image": str(tmp_path / "a.png")}
    words = [f"{name}={file}" for name, file in files.items()]
    command = [venv / "bin" / "tex-runtime", exported[1], *words]
    line = json.loads(subprocess.run(command, check=True, capture_output=True, env={}).stdout)
    expected = runtime.predict(**files)
    assert line["label"] == expected["label"]
    assert line["probability"] == pytest.approx(expected["probability"], abs=1e-5)
