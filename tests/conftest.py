"""What pytest looks for first; fixtures and helpers are in :mod:`common`.

The process that hands out tests to others (``-n 2``) runs none, so it imports neither them nor
PyTorch, and the others begin that much earlier.
"""

import os
from importlib import import_module
from typing import Any

import pytest

# of each process, before PyTorch is imported: threads of two processes would wait for each other,
# and what they compute here is little
os.environ.setdefault("OMP_NUM_THREADS", "1")


def pytest_configure(config: pytest.Config) -> None:
    """Add the fixtures where tests run."""
    hands_out = config.getoption("numprocesses", None) and not hasattr(config, "workerinput")
    if not hands_out:
        config.pluginmanager.import_plugin("common")


def __getattr__(name: str) -> Any:
    """Return a helper, so that ``from conftest import make_trace`` finds it."""
    if name.startswith(("_", "pytest")):  # which pytest asks every conftest for
        raise AttributeError(name)
    return getattr(import_module("common"), name)
