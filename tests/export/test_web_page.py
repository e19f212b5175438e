"""The files of the page: ONNX Runtime Web is fetched once, and only the tested package is taken."""

import json
from pathlib import Path

import pytest
from docs_world import write_web_runtime

from tex_lightning.errors import UserError
from tex_lightning.export import web_page
from tex_lightning.export.web_page import FILES, page_files, runtime_files

EXPECTED = {kept: name.encode() for name, kept in FILES.items()}


@pytest.fixture
def package(tmp_path, monkeypatch) -> Path:
    """A package of the npm registry with small files, trusted for this test."""
    path = tmp_path / "onnxruntime-web" / "-" / f"onnxruntime-web-{web_page.VERSION}.tgz"
    path.parent.mkdir(parents=True)
    monkeypatch.setattr(web_page, "INTEGRITY", write_web_runtime(path))
    monkeypatch.setenv("NPM_CONFIG_REGISTRY", tmp_path.as_uri())
    return path


def test_it_is_fetched_once_from_the_registry_of_the_machine(package, tmp_path):
    cache = tmp_path / "cache"
    assert runtime_files(None, cache) == EXPECTED
    package.unlink()
    assert runtime_files(None, cache) == EXPECTED
    (cache / package.name).write_bytes(b"half of it")
    with pytest.raises(UserError, match=r"does not give .* export\.web_runtime"):
        runtime_files(None, cache)


def test_a_given_package_is_taken_if_it_is_the_one_that_was_tested(package, tmp_path, monkeypatch):
    assert runtime_files(str(package), tmp_path / "cache") == EXPECTED
    assert not (tmp_path / "cache").exists()
    with pytest.raises(UserError, match=r"none\.tgz"):
        runtime_files(str(tmp_path / "none.tgz"), tmp_path)
    monkeypatch.setattr(web_page, "INTEGRITY", "sha512-another")
    with pytest.raises(UserError, match=r"SHA-512 differs\); give that package"):
        runtime_files(str(package), tmp_path)


def test_the_page_holds_its_scripts_the_runtime_and_the_card():
    files = page_files({"classes": ["a"]}, EXPECTED)
    assert json.loads(files["model.json"]) == {"classes": ["a"]}
    assert {f"onnxruntime/{name}" for name in EXPECTED} < files.keys()
    page = files["index.html"].decode()
    assert "script/page.js" in page
    assert "script/page.js" in files
