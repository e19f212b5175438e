"""Which senses of a user's folder are composed with every command."""

import pytest

from tex_lightning.config.user_folders import with_own_senses


@pytest.fixture
def given(tmp_path):
    """The override that names a folder with a sense, and a file that others begin with."""
    (tmp_path / "sense").mkdir()
    (tmp_path / "sense" / "shared.yaml").write_text("hop: 3\n")
    (tmp_path / "sense" / "force.yaml").write_text("defaults: [signal, shared, _self_]\n")
    return f"hydra.searchpath=[file://{tmp_path}]"


def test_senses_are_composed_once_and_no_file_that_they_begin_with(given, tmp_path):
    for name in ("base", "haptic"):  # a base for others, and a name of the package's
        (tmp_path / "sense" / f"{name}.yaml").write_text("defaults: [signal, _self_]\n")
    found = with_own_senses([given, "seed=1"])
    assert found == [given, "seed=1", "+sense@model.force=force"]
    assert with_own_senses(found) == found


def test_what_is_asked_for_is_composed_so_that_what_it_lacks_is_told(given):
    asked = [given, "model.senses=[shared]"]
    added = ["+sense@model.force=force", "+sense@model.shared=shared"]
    assert with_own_senses(asked) == [*asked, *added]


def test_a_file_that_cannot_be_read_is_left_to_hydra(given, tmp_path):
    (tmp_path / "sense" / "broken.yaml").write_bytes(b"\xff\xfe\x00")
    assert "+sense@model.broken=broken" in with_own_senses([given])
