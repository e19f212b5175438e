"""Senses that are found in a user's folders."""

from tex_lightning.config.search import (
    register_folders,
    repeated_arguments,
    use_config_dir,
    with_own_senses,
)


def test_senses_of_the_users_folders_are_composed_once(tmp_path):
    register_folders()
    (tmp_path / "sense").mkdir()
    for name in ("force", "base", "haptic"):  # a base for others, and a name of the package's
        (tmp_path / "sense" / f"{name}.yaml").touch()
    given = [f"hydra.searchpath=[file://{tmp_path}]", "seed=1"]
    found = with_own_senses(given)
    assert found == [*given, "+sense@model.force=force"]
    assert with_own_senses(found) == found


def test_another_command_finds_the_same_folders(tmp_path):
    register_folders()
    senses = {}
    for folder, name in (("given", "force"), ("searched", "smell")):
        (tmp_path / folder / "sense").mkdir(parents=True)
        (tmp_path / folder / "sense" / f"{name}.yaml").touch()
        senses[folder] = f"+sense@model.{name}={name}"
    use_config_dir(["--config-dir", str(tmp_path / "given")])
    try:
        # the command line's own folder is on Hydra's path as well
        paths = [f"file://{tmp_path}/{folder}" for folder in senses]
        given = ["seed=1", *senses.values(), "+sense@model.grip=haptic"]
        assert repeated_arguments(given, paths) == [
            "--config-dir", f"{tmp_path}/given", f'hydra.searchpath=["file://{tmp_path}/searched"]',
            *given,
        ]  # fmt: skip
    finally:
        use_config_dir([])
