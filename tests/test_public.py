"""The public names: what they are, and that their examples and the README's run as they stand."""

import doctest
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
import soundfile
from conftest import RATE, make_photo, make_trace, own_arrays
from PIL import Image

import tex_lightning as tl
from tex_lightning.config import CONF


@pytest.fixture(scope="module")
def user_folder(untrained, surfaces, cache, tmp_path_factory):
    """Where the examples run: a finished run RUN, a data set DIR, a trace and a photo."""
    folder = tmp_path_factory.mktemp("user")
    shutil.copytree(untrained, folder / "RUN")
    (folder / "DIR").symlink_to(surfaces)
    soundfile.write(folder / "A.wav", make_trace(0, 0), RATE, subtype="FLOAT")
    Image.fromarray(make_photo(1, 0)).save(folder / "B.jpg")
    return folder


@pytest.fixture(autouse=True)
def _inside(user_folder, cache, monkeypatch):
    monkeypatch.chdir(user_folder)
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))


LAZY = """
import sys, tex_lightning as tl
assert not {"torch", "hydra"} & {*sys.modules}
assert {*tl.__all__} <= {*dir(tl)}
from tex_lightning.__main__ import main
sys.argv[1:] = ["--help=all"]
main()
assert not {"torch", "lightning"} & {*sys.modules}
import tex_lightning.tasks.predict
assert not {"lightning", "matplotlib", "torch._dynamo"} & {*sys.modules}
"""


def test_what_is_slow_to_import_is_imported_when_it_is_asked_for():
    subprocess.run([sys.executable, "-c", LAZY], check=True, stdout=subprocess.DEVNULL)
    with pytest.raises(AttributeError, match="no attribute 'laod'"):
        _ = tl.laod


@pytest.mark.parametrize("name", tl.__all__)
def test_every_public_name_has_an_example_that_runs(name):
    (example,) = doctest.DocTestFinder(recurse=False).find(getattr(tl, name), name, globs={})
    assert example.examples, f"{name} has no example"
    said = []
    doctest.DocTestRunner().run(example, out=said.append)
    assert not said, "".join(said)


def test_the_python_of_the_readme_runs():
    """That of the other pages is run by tests/test_docs_run.py."""
    text = (CONF.parent / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    samples = make_trace(0, 0)
    known = {"samples": samples, "frame": make_photo(0, 0), "chunks": np.split(samples, 4)}
    known |= own_arrays()
    for block in blocks:
        exec(block, known)
    assert ".predict(" in "\n".join(blocks)


def test_every_public_name_is_in_the_reference():
    page = (CONF.parent / "docs" / "api.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"^\.\. auto\w+:: tex_lightning\.(\w+)$", page, re.M)) == sorted(
        tl.__all__
    )
