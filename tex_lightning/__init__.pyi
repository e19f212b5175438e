"""The public names: what ``__init__.py`` imports on first use, and what type checkers read."""

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

__version__: str
