"""The package installs from the URL of a repository without a checkout."""

import os
import subprocess
import sys

import pytest
from documentation import ROOT


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
