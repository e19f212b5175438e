from pathlib import Path

import pytest
from docs_world import write_web_runtime

from tex_lightning.errors import UserError
from tex_lightning.export import web_runtime
from tex_lightning.export.web_runtime import FILES, runtime_files

from .browser import served


@pytest.fixture
def package(tmp_path, monkeypatch) -> Path:
    """A package of the npm registry with small files, trusted for this test, and no npm."""
    path = tmp_path / "onnxruntime-web" / "-" / f"onnxruntime-web-{web_runtime.VERSION}.tgz"
    path.parent.mkdir(parents=True)
    monkeypatch.setattr(web_runtime, "INTEGRITY", write_web_runtime(path))
    monkeypatch.setattr("shutil.which", lambda name: None)
    return path


EXPECTED = {kept: name.encode() for name, kept in FILES.items()}


def test_it_is_fetched_once_from_the_registry_of_the_machine(package, tmp_path, monkeypatch):
    cache = tmp_path / "cache"
    with served(tmp_path) as address:
        monkeypatch.setenv("NPM_CONFIG_REGISTRY", address)
        assert runtime_files(None, cache) == EXPECTED
    assert runtime_files(None, cache) == EXPECTED  # the registry is gone
    (cache / package.name).write_bytes(b"half of it")
    with pytest.raises(UserError, match=r"does not give .* export\.web_runtime"):
        runtime_files(None, cache)


def test_it_is_taken_from_a_package_or_the_folder_of_one(package, tmp_path):
    assert runtime_files(str(package), tmp_path / "cache") == EXPECTED
    dist = tmp_path / "node_modules" / "onnxruntime-web" / "dist"
    dist.mkdir(parents=True)
    for name in FILES:
        (dist / name).write_text(name)
    assert runtime_files(str(tmp_path), tmp_path / "cache") == EXPECTED
    assert runtime_files(str(dist), tmp_path / "cache") == EXPECTED
    assert not (tmp_path / "cache").exists()


def test_another_package_is_refused(package, tmp_path, monkeypatch):
    monkeypatch.setattr(web_runtime, "INTEGRITY", "sha512-another")
    with pytest.raises(UserError, match=r"SHA-512 differs\); give its folder"):
        runtime_files(str(package), tmp_path)
    with pytest.raises(UserError, match=r"lacks ort\.wasm"):
        runtime_files(str(package.parent), tmp_path)
    with pytest.raises(UserError, match="does not exist"):
        runtime_files(str(tmp_path / "none.tgz"), tmp_path)
