"""Train and classify arrays with the conventions of scikit-learn: the second door of the package.

What is behind it is what the command line runs: the same composition, checks, training and
decision. So the same recordings and the same seed give the same weights and labels.
"""

import os
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt
import torch
from omegaconf import OmegaConf
from sklearn.base import BaseEstimator, ClassifierMixin, TransformerMixin
from sklearn.metrics import accuracy_score
from sklearn.utils import check_array
from sklearn.utils.validation import (
    _check_feature_names,
    _check_n_features,
    check_consistent_length,
    check_is_fitted,
    column_or_1d,
)

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.cli import RUN_LOCK
from tex_lightning.config import Config, Job
from tex_lightning.config.check import checked_config
from tex_lightning.config.composition import compose_config
from tex_lightning.config.mistakes import to_user_error
from tex_lightning.config.overrides import as_key_value, named_model
from tex_lightning.config.signatures import misfits
from tex_lightning.config.user_folders import use_config_dir
from tex_lightning.core.console import showing_messages, verbosity
from tex_lightning.core.devices import torch_defaults
from tex_lightning.core.progress import ending_stages
from tex_lightning.core.run_folder import checkpoint_of
from tex_lightning.data.derived_settings import derive_settings
from tex_lightning.data.readers.arrays import (
    MANIFEST,
    Given,
    GivenSample,
    check_complete,
    groups_of,
    is_table,
    labels_by_name,
    labels_of,
    map_samples,
    samples_of,
    with_rate,
    write_samples,
)
from tex_lightning.errors import InvalidInput
from tex_lightning.export.files import export_checkpoint
from tex_lightning.inference.prediction import Prediction
from tex_lightning.inference.predictor import Predictor, load
from tex_lightning.learning.adaptation import adapt, sample_features
from tex_lightning.learning.processes import prepared
from tex_lightning.studies.fold import open_training, train_model
from tex_lightning.studies.new_classes import enroll, open_new_classes
from tex_lightning.studies.notes import recording_notes
from tex_lightning_runtime.files import expanded
from tex_lightning_runtime.quality import Quality
from tex_lightning_runtime.samples import readable

Array = npt.NDArray[Any]
Floats = npt.NDArray[np.float64]


class Estimator(ClassifierMixin, TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """A model of this package as a classifier of scikit-learn.

    ``X`` holds recordings: an array (recordings, samples) or (recordings, axes, samples), or a list
    (or column of pandas) of (samples,) or (axes, samples) of any lengths, of pairs of these and
    their rate in Hz, of paths, or of photos (height, width, 3) uint8. Of several modalities it is
    ``{"haptic": […], "image": […]}``, a list of such dictionaries, one for each sample, or a table
    of pandas with a column for each; these two can be divided by scikit-learn. None and an empty
    cell of pandas are an absent modality. At least two classes are needed.

    Args:
        model: A preset (``few/haptic``, an ``experiment``) or a model (``haptic``) by its name.
        rate: Sampling rate in Hz of arrays, and of files that state none; None assumes 10 kHz.
        seed: Seed of the training.
        verbose: 0 says nothing, 1 shows progress and messages, 2 those of libraries, too.
        directory: Folder in which every fit makes a run folder with checkpoints, metrics and
            TensorBoard events; None keeps none.
        config_dir: Folder with configuration files of one's own, as ``--config-dir``.
        **keys: Further keys as Hydra names them, with or without ``model.`` in front:
            ``**{"haptic.features.thresholds": 5, "decision.rule": "vote"}``.

    Attributes:
        classes_: Labels in the order of the columns of :meth:`predict_proba`.
        notes_: What looks wrong in the recordings, a sentence each, which is a warning, too.
        predictor_: What :func:`tex_lightning.load` gives for the trained model.
        adaptation_: What :meth:`adapt` did last: ``reason`` why it left the model as it was, or an
            empty text, and numbers (:class:`~tex_lightning.learning.adaptation.Adaptation`).
        n_features_in_: Length of the second dimension of an array that it was fitted to.

    Example:
        >>> import numpy as np, tex_lightning as tl
        >>> time, rng = np.arange(8_000) / 2_000, np.random.default_rng(0)
        >>> tones = [np.sin(2 * np.pi * f * time) for f in (50, 50, 50, 200, 200, 200)]
        >>> X = np.stack(tones) + 0.1 * rng.standard_normal((6, 8_000))
        >>> model = tl.Estimator("few/haptic", rate=2_000).fit(X, ["a", "a", "a", "b", "b", "b"])
        >>> model.predict(X[2:4]).tolist(), model.predict_proba(X).shape
        (['a', 'b'], (6, 2))
    """

    def __init__(
        self,
        model: str = "few/haptic",
        *,
        rate: float | None = None,
        seed: int = 0,
        verbose: bool | int = 0,
        directory: str | Path | None = None,
        config_dir: str | Path | None = None,
        **keys: Any,  # noqa: ANN401
    ) -> None:
        self.model = model
        self.rate = rate
        self.seed = seed
        self.verbose = verbose
        self.directory = directory
        self.config_dir = config_dir
        self.set_params(**keys)  # attributes, as the others

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Return all parameters, and the keys that were given."""
        names = (name for name in vars(self) if not name.startswith("_") and not _is_fitted(name))
        return {name: getattr(self, name) for name in sorted(names)}

    def set_params(self, **params: Any) -> Self:  # noqa: ANN401
        """Set parameters and keys, such as ``**{"haptic.features.thresholds": 5}``.

        Raises:
            UserError: If the name is that of a method, or of what a fit keeps.
        """
        for name, value in params.items():
            if name[:1] in ("", "_") or _is_fitted(name) or hasattr(type(self), name):
                raise InvalidInput(
                    f"{name!r} is no parameter; give a key of Hydra, which `python -m "
                    "tex_lightning --help=all` lists."
                )
            setattr(self, name, value)
        return self

    @property
    def _keys(self) -> dict[str, Any]:
        """The keys of Hydra that were given."""
        own = self._get_param_names()
        return {name: value for name, value in self.get_params().items() if name not in own}

    def fit(self, X: Any, y: Any, groups: Any = None) -> Self:  # noqa: ANN401
        """Train on all recordings; ``groups`` are never divided where something is left out.

        Args:
            X: Recordings, see the class.
            y: (samples,) labels: text, numbers or truth values.
            groups: (samples,) sessions, specimens or persons; None is each on its own.

        Raises:
            UserError: If the recordings or the settings cannot be used; a ``ValueError``, too.
        """
        classes, labels = labels_of(y)
        with self._session() as folder:
            overrides = self._overrides(folder)
            composed, hydra = compose_config(overrides), OmegaConf.create({"hydra": {}})
            job = Job(tuple(overrides), folder, "python", True, (), composed, hydra)
            config = checked_config(composed, job.sets)
            samples = self._samples(X, config.model.modalities)
            check_consistent_length(samples, labels)
            known = None if groups is None else groups_of(groups, samples)
            write_samples(samples, labels, known, folder)
            config, job = derive_settings(config, job)
            classifier = self._train(config, job)
            self.classes_, self.predictor_ = classes, Predictor(classifier, config)
            self._keep_shape(X)
        for note in self.notes_:
            warnings.warn(note, stacklevel=2)
        return self

    def predict(self, X: Any) -> Array:  # noqa: ANN401
        """Return a label for each recording; ``unknown`` as text with ``decision.unknown``."""
        with self._to_classify(X) as samples:
            labels = [str(prediction.label) for prediction in map_samples(samples, self._predicted)]
        known = labels_by_name(self.classes_)
        dtype = self.classes_.dtype if {*labels} <= known.keys() else object
        return np.array([known.get(label, label) for label in labels], dtype=dtype)

    def score(self, X: Any, y: Any, sample_weight: Any = None) -> float:  # noqa: ANN401
        """Return the accuracy of the labels; of a sample of any class ``unknown`` is wrong."""
        check_is_fitted(self)
        true = column_or_1d(y)
        check_complete("y", y)
        names = {label: name for name, label in labels_by_name(self.classes_).items()}
        given, found = (
            [names.get(label, str(label)) for label in labels.tolist()]
            for labels in (true, self.predict(X))
        )
        return float(accuracy_score(given, found, sample_weight=sample_weight))

    def predict_proba(self, X: Any) -> Floats:  # noqa: ANN401
        """Return mean probabilities (samples, classes) over all fragments, which sum to 1."""
        with self._to_classify(X) as samples:
            rows = [found.probabilities for found in map_samples(samples, self._predicted)]
        names = [*labels_by_name(self.classes_)]
        return np.array([[row[name] for name in names] for row in rows], dtype=np.float64)

    @torch.inference_mode()
    def transform(self, X: Any) -> Array:  # noqa: ANN401
        """Return embeddings (samples, D): mean features before the class scores, sense by sense."""
        with self._to_classify(X) as samples:
            return np.stack([*map_samples(samples, self._embedding)])

    def _embedding(self, sample: GivenSample) -> Array:
        classifier, decoded = self.predictor_.classifier, self._decoded(sample)
        classifier.require(decoded)
        parts = [
            classifier.embedding(name, decoded[sense.modality][0]).mean(dim=1)
            for name, sense in classifier.senses.items()
        ]
        return torch.cat(parts).cpu().numpy()

    def get_feature_names_out(self, input_features: Any = None) -> Array:  # noqa: ANN401
        """Return names of the columns of :meth:`transform`: the sense and a number."""
        check_is_fitted(self)
        classifier, names = self.predictor_.classifier, []
        for name in classifier.senses:  # of a baseline its class scores
            known = classifier.statistics_of(name)
            size = len(self.classes_) if known is None else known.means.shape[1]
            names += [f"{name}{number}" for number in range(size)]
        return np.array(names, dtype=object)

    @torch.inference_mode()
    def explain(self, X: Any) -> list[dict[str, Array]]:  # noqa: ANN401
        """Return the class probabilities of every fragment, by sense.

        Returns:
            For each sample by sense the probabilities (rows, columns, classes) that this sense
            alone gives at each position of a photo; of a signal there is one row, in order of time,
            without rests where the model leaves them out.
        """
        with self._to_classify(X) as samples:
            return [*map_samples(samples, self._explained)]

    def _explained(self, sample: GivenSample) -> dict[str, Array]:
        """Return probabilities (rows, columns, classes) of fragments in the order of classes."""
        classifier, decoded = self.predictor_.classifier, self._decoded(sample)
        places = [classifier.card.classes.index(label) for label in labels_by_name(self.classes_)]
        found = {}
        for name, sense in classifier.senses.items():
            if sense.modality in decoded:
                scores = classifier.fragment_scores(name, decoded[sense.modality][0])
                shares = (scores / classifier.card.temperature).softmax(dim=0)
                found[name] = shares[places].movedim(0, -1).cpu().numpy()
        return found

    def enroll(self, X: Any, y: Any) -> Self:  # noqa: ANN401
        """Add the classes of ``y`` without training anew; all of them have to be new.

        Raises:
            UserError: If a class is known, or classes cannot be added to this model.
        """
        check_is_fitted(self)
        classes, labels = labels_of(y, least=1)
        before, together = self.predictor_, np.unique(np.concatenate([self.classes_, classes]))
        if labels_by_name(together).keys() != labels_by_name(self.classes_).keys() | {*labels}:
            raise InvalidInput(
                f"The classes are {self.classes_.dtype}, and y is {classes.dtype}; give labels of "
                "the same type."
            )
        with self._session() as folder:
            samples = self._samples(X, before.card.modalities)
            check_consistent_length(samples, labels)
            manifest = write_samples(samples, labels, None, folder)
            given = ["task=enroll", as_key_value("checkpoint", manifest)]
            composed = compose_config([*given, *_manifest_overrides(manifest, folder, self.rate)])
            data = checked_config(composed).data
            extended = enroll(before.classifier, open_new_classes(data, before.classifier))
            self.predictor_ = Predictor(extended, before.config)
            self.classes_ = together
        return self

    def adapt(self, X: Any) -> Self:  # noqa: ANN401
        """Fit the model again with recordings without labels, which it is to classify.

        Where that would not tell them apart more clearly, the model stays as it is, and a warning
        says why. Their order makes no difference.

        Raises:
            UserError: If the model is not fitted in closed form, or keeps no features of its
                training recordings.
        """
        with self._to_classify(X) as samples:
            before = self.predictor_
            features = sample_features(before.classifier, map_samples(samples, self._decoded))
            self.adaptation_ = adapt(before.classifier, features, before.card.unknown_above)
            self.predictor_ = Predictor(self.adaptation_.classifier, before.config)
        if self.adaptation_.reason:
            warnings.warn(str(self.adaptation_), stacklevel=2)
        return self

    def save(self, path: str | Path) -> Path:
        """Write a checkpoint that :func:`tex_lightning.load` and every task take."""
        check_is_fitted(self)
        target = expanded(path).resolve()
        self.predictor_.classifier.save(target)
        return target

    @classmethod
    def load(cls, path: str | Path, *, trusted: Sequence[str] = (), **params: Any) -> Self:  # noqa: ANN401
        """Return the fitted estimator of a checkpoint or run folder, also the command line's.

        Args:
            path: A checkpoint, or the run folder that holds it.
            trusted: Packages whose classes the checkpoint may name, see :func:`tex_lightning.load`.
            **params: Parameters, and keys of a prediction such as ``decision.rule``; :meth:`fit`
                would train by these.
        """
        estimator = cls(**params)
        with estimator._session():
            keys = [as_key_value(name, value) for name, value in estimator._keys.items()]
            estimator.predictor_ = load(path, *keys, trusted=trusted)
            estimator.classes_ = np.unique(estimator.predictor_.classes)  # metrics take them sorted
        return estimator

    def export(self, folder: str | Path, format: str = "onnx") -> list[Path]:
        """Write the model to a folder: ``onnx`` for ONNX Runtime, ``web`` a page, ``card`` text.

        Returns:
            The files.
        """
        check_is_fitted(self)
        with self._session() as scratch:
            checkpoint = self.save(scratch / "model.ckpt")
            given = {"checkpoint": checkpoint, "export.format": format}
            overrides = [as_key_value(name, value) for name, value in given.items()]
            config = checked_config(compose_config(["task=export", *overrides]))
            out = expanded(folder)
            out.mkdir(parents=True, exist_ok=True)
            written = export_checkpoint(config, checkpoint, out)
        return [out / name for name in written["files"]]

    @contextmanager
    def _session(self) -> Iterator[Path]:
        """Yield a temporary folder to work in, alone and with messages as ``verbose`` allows.

        Raises:
            InvalidInput: If the work ends with a user's mistake.
        """
        if wrong := "; ".join(misfits("", type(self), self.get_params() | {"model": ""})):
            raise InvalidInput(f"{wrong}.")
        with (
            RUN_LOCK,
            verbosity(self.verbose),
            showing_messages(),
            ending_stages(),
            torch_defaults(),
            tempfile.TemporaryDirectory(prefix="tex_lightning_") as scratch,
        ):
            folder = Path(scratch).resolve()
            try:
                if self.config_dir is not None:
                    use_config_dir([f"--config-dir={self.config_dir}"])
                yield folder
            except Exception as error:
                mistake = to_user_error(error, began=True)
                if mistake is None:
                    raise
                raise InvalidInput(*_without_folder(mistake.args, folder)) from error
            finally:
                use_config_dir([])

    @contextmanager
    def _to_classify(self, X: Any) -> Iterator[list[GivenSample]]:  # noqa: ANN401
        """Give the samples of recordings to classify."""
        check_is_fitted(self)
        modalities = self.predictor_.card.modalities
        with self._session():
            if hasattr(self, "feature_names_in_") and is_table(X, modalities):
                _check_feature_names(self, X, reset=False)
            yield self._samples(X, modalities)

    def _predicted(self, sample: GivenSample) -> Prediction:
        recordings, rates = self._with_rates(sample)
        return self.predictor_.predict(rate=rates, **recordings)

    def _decoded(self, sample: GivenSample) -> dict[str, tuple[torch.Tensor, Quality]]:
        recordings, rates = self._with_rates(sample)
        return self.predictor_.decoded(recordings, rate=rates)

    def _with_rates(self, sample: GivenSample) -> tuple[dict[str, Given], dict[str, float | None]]:
        """Return recordings, and the rate of each that has one of its own or none."""
        pairs = {name: with_rate(given) for name, given in sample.items() if given is not None}
        usual = None if self.rate is None else float(self.rate)
        rates = {name: usual if rate is None else rate for name, (_, rate) in pairs.items()}
        return {name: given for name, (given, _) in pairs.items()}, rates

    def _samples(self, X: Any, modalities: Sequence[str]) -> list[GivenSample]:  # noqa: ANN401
        """Return samples of what is an array or any other form of recordings."""
        if is_table(X, modalities):
            X = check_array(readable(X, "X"), allow_nd=True)
        return samples_of(X, modalities)

    def _keep_shape(self, X: Any) -> None:  # noqa: ANN401
        """Keep what scikit-learn wants to know of an array, and nothing of an earlier fit."""
        for name in ("n_features_in_", "feature_names_in_"):
            self.__dict__.pop(name, None)
        if is_table(X, self.predictor_.card.modalities):
            _check_feature_names(self, X, reset=True)
            _check_n_features(self, X, reset=True)

    def _overrides(self, folder: Path) -> list[str]:
        """Return the command line for a training on the manifest in a folder."""
        given = {"seed": self.seed, **self._keys}
        if "task" in given:
            raise InvalidInput("Estimator takes no task, since fit trains; run others by tl.train.")
        return [
            "task=fit",
            named_model(self.model),
            *_manifest_overrides(folder / MANIFEST, folder, self.rate),
            *(as_key_value(name, value) for name, value in given.items()),
        ]

    def _train(self, config: Config, job: Job) -> SurfaceClassifier:
        """Train as the command line would, and return the whole model."""
        folder = job.directory
        if self.directory is None:
            config = replace(config, logger={})
        else:
            name = f"{datetime.now():%Y-%m-%d_%H-%M-%S_%f}"
            self.run_folder_ = folder = expanded(self.directory).resolve() / name
        with prepared(config, job):
            dataset = open_training(config, folder)
            self.notes_ = _without_folder(recording_notes(dataset), job.directory)
            train_model(config, dataset, folder)
        return load_classifier(checkpoint_of(folder, config.model.kind))

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "predictor_")

    def __sklearn_tags__(self) -> Any:  # noqa: ANN401
        tags = super().__sklearn_tags__()
        tags.input_tags.three_d_array = True
        tags.input_tags.string = True
        tags.transformer_tags.preserves_dtype = []
        return tags


def _manifest_overrides(manifest: Path, cache: Path, rate: float | None) -> list[str]:
    """Return overrides for a manifest, all of which is used; what is decoded goes with it."""
    given = {"data.manifest": manifest, "data.cache_dir": cache, "data.file_rate": rate}
    everything = ["data=manifest", "data.test_fold=null"]
    return [*everything, *(as_key_value(name, value) for name, value in given.items())]


def _without_folder(lines: Sequence[object], folder: Path) -> list[str]:
    """Return lines with the names of a folder's files alone."""
    return [str(line).replace(f"{folder}{os.sep}", "") for line in lines]


def _is_fitted(name: str) -> bool:
    """Return whether an attribute is what a fit keeps, and no key such as x.network._target_."""
    return name.endswith("_") and "." not in name
