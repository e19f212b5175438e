"""The package installs from a repository and starts; what is pinned is all."""

import os
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import numpy as np
import pytest
from conftest import make_trace
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).parents[1]
PROJECT = ROOT / "pyproject.toml"
COMPROMISED = ("2.6.2", "2.6.3")  # GHSA-w37p-236h-pfx3: they steal credentials
VULNERABLE = ("11.1.0", "12.2.0", "12.3.0")  # CVE-2026-4775 in libtiff, and later ones


def names(requirements):
    return {canonicalize_name(Requirement(each).name) for each in requirements}


def direct(project=PROJECT):
    """Requirements of the distribution and of all its extras."""
    project = tomllib.loads(project.read_text())["project"]
    extras = project.get("optional-dependencies", {}).values()
    every = [*project["dependencies"], *(each for extra in extras for each in extra)]
    found = [Requirement(each) for each in every]
    return [each for each in found if canonicalize_name(each.name) != "tex-lightning"]


def pins():
    """Name and version of every line of constraints.txt."""
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    found = [line.partition("==") for line in lines if line and not line.startswith("#")]
    assert all(mark == "==" and name and version for name, mark, version in found)
    return [(canonicalize_name(name), Version(version)) for name, _, version in found]


def test_every_requirement_is_pinned_once_within_its_bounds():
    pinned = dict(pins())
    assert len(pinned) == len(pins())
    for requirement in direct():
        assert requirement.specifier.contains(pinned[canonicalize_name(requirement.name)])


@pytest.mark.parametrize(
    ("project", "name", "releases"),
    [
        ("pyproject.toml", "lightning", COMPROMISED),
        ("pyproject.toml", "pytorch-lightning", COMPROMISED),
        ("pyproject.toml", "pillow", VULNERABLE),
        ("runtime/pyproject.toml", "pillow", VULNERABLE),
    ],
)
def test_bad_releases_are_excluded(project, name, releases):
    (requirement,) = [each for each in direct(ROOT / project) if each.name == name]
    assert not any(requirement.specifier.contains(each) for each in releases)


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
        "import tex_lightning.cli, tex_lightning.report.sweep"
    )
    finished = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert finished.returncode == 0, finished.stderr


def test_a_prediction_imports_nothing_slow_that_it_does_not_use(untrained, bands, tmp_path):
    np.save(tmp_path / "a.npy", make_trace(0, 0))
    code = (
        f"import sys, tex_lightning as tl\nfor model in {[str(untrained), str(bands)]}: "
        "tl.load(model).predict(haptic='a.npy')\nprint(*sys.modules)"
    )
    finished = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, check=True, capture_output=True, text=True
    )
    slow = {"lightning", "matplotlib", "pandas", "scipy.optimize", "scipy.stats", "sklearn",
            "sympy", "torch._dynamo"}  # fmt: skip
    assert slow.isdisjoint(finished.stdout.split())


@pytest.mark.slow  # fetches the build backend from the network
def test_the_package_installs_from_a_bare_clone(tmp_path):
    bare, target = tmp_path / "bare", tmp_path / "target"
    subprocess.run(["git", "clone", "-q", "--bare", str(ROOT), str(bare)], check=True)
    pip = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", str(target)]
    subprocess.run([*pip, f"git+file://{bare}"], check=True)
    environment = os.environ | {"PYTHONPATH": str(target)}
    command = [sys.executable, "-m", "tex_lightning", "--cfg", "job"]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, check=True, capture_output=True, text=True
    )
    assert "task: fit" in done.stdout
    assert (target / "tex_lightning" / "conf" / "config.yaml").is_file()
