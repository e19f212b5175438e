"""Surface material classification from acceleration traces and photos."""

import os
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tex_lightning.classifier.classifier import SurfaceClassifier as SurfaceClassifier
    from tex_lightning.cli import Results as Results
    from tex_lightning.cli import train as train
    from tex_lightning.data.datamodule import SurfaceData as SurfaceData
    from tex_lightning.data.manifest import read_manifest as read_manifest
    from tex_lightning.data.readers.folder import read_folder as read_folder
    from tex_lightning.data.recordings import Recording as Recording
    from tex_lightning.data.recordings import Recordings as Recordings
    from tex_lightning.errors import UserError as UserError
    from tex_lightning.estimator import Estimator as Estimator
    from tex_lightning.inference.prediction import Prediction as Prediction
    from tex_lightning.inference.predictor import Predictor as Predictor
    from tex_lightning.inference.predictor import load as load
    from tex_lightning.networks.fusionnet import FusionNet as FusionNet
    from tex_lightning.networks.hapticnet import HapticNet as HapticNet
    from tex_lightning.networks.visualnet import VisualNet as VisualNet

if find_spec("tex_lightning_runtime") is None:  # a checkout that is not installed
    sys.path.append(str(Path(__file__).parents[1] / "runtime"))

__version__ = "0.2.0"

# Where a public name is defined. Most modules need PyTorch, which is imported when one is asked
# for: a mistyped command fails before.
_MODULES = {
    "Estimator": "estimator",
    "FusionNet": "networks.fusionnet",
    "HapticNet": "networks.hapticnet",
    "Prediction": "inference.prediction",
    "Predictor": "inference.predictor",
    "Recording": "data.recordings",
    "Recordings": "data.recordings",
    "Results": "cli",
    "SurfaceClassifier": "classifier.classifier",
    "SurfaceData": "data.datamodule",
    "UserError": "errors",
    "VisualNet": "networks.visualnet",
    "load": "inference.predictor",
    "read_folder": "data.readers.folder",
    "read_manifest": "data.manifest",
    "train": "cli",
}

__all__ = [*_MODULES]

# PyTorch's threads spin while they wait for each other, and beside another busy process they wait
# for one that does not run: up to ten times as long. GNU's threads, which read the second, spin for
# a moment before they sleep: of all settings tried it loses least, idle and busy (docs/scale.md).
# OpenMP reads these once, when PyTorch is imported.
if not {"OMP_WAIT_POLICY", "GOMP_SPINCOUNT", "KMP_BLOCKTIME"} & os.environ.keys():
    os.environ |= {"OMP_WAIT_POLICY": "PASSIVE", "GOMP_SPINCOUNT": "3000"}


def __getattr__(name: str) -> object:
    """Import a public name on first use."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    """Return all names, also those that are not imported yet."""
    return sorted({*globals(), *__all__})
