"""Senses that are found in a user's folders."""

from tex_lightning.config.search import register_folders, with_own_senses


def test_senses_of_the_users_folders_are_composed_once(tmp_path):
    register_folders()
    (tmp_path / "branch").mkdir()
    for name in ("force", "base", "haptic"):  # a base for others, and a name of the package's
        (tmp_path / "branch" / f"{name}.yaml").touch()
    given = [f"hydra.searchpath=[file://{tmp_path}]", "seed=1"]
    found = with_own_senses(given)
    assert found == [*given, "+branch@model.force=force"]
    assert with_own_senses(found) == found
