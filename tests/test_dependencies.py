"""What the README's first command installs is enough to start."""

import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

PROJECT = Path(__file__).parents[1] / "pyproject.toml"


def names(requirements):
    return {re.match(r"[\w-]+", each)[0].replace("_", "-").lower() for each in requirements}


def test_no_optional_library_is_imported_before_it_is_asked_for():
    project = tomllib.loads(PROJECT.read_text())["project"]
    extras = project["optional-dependencies"]
    optional = names([*extras["baselines"], *extras["live"]]) - names(project["dependencies"])
    modules = [
        module
        for module, owners in packages_distributions().items()
        if {owner.replace("_", "-").lower() for owner in owners} & optional
    ]
    assert "aeon" in modules
    code = (
        f"import sys; sys.modules.update(dict.fromkeys({modules!r})); "  # None: not installed
        "import tex_lightning.__main__, tex_lightning.dispatch, tex_lightning.report.sweep"
    )
    finished = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert finished.returncode == 0, finished.stderr
