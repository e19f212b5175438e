"""Recordings, labels and groups that are given in Python as arrays or paths.

The recordings are written to a folder with a manifest, so that everything after it treats them as
it does the files of others.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from PIL import Image
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_consistent_length, column_or_1d

from tex_lightning.data.manifest import write_manifest
from tex_lightning.data.recordings import Recording, Recordings, check_is_list, normal_form
from tex_lightning.errors import InvalidInput, UserError, listed
from tex_lightning_runtime.files import expanded
from tex_lightning_runtime.pixels import as_pixels
from tex_lightning_runtime.samples import Array, as_array, as_trace

T = TypeVar("T")
Given = Any  # a path, samples or pixels that NumPy can read, or a pair of samples and their rate
GivenSample = Mapping[str, Given]  # by modality; None is absent
MANIFEST = "manifest.csv"
ALONE = "; those that stand alone get one of their own"


def is_table(given: Any, modalities: Sequence[str]) -> bool:  # noqa: ANN401
    """Return whether recordings stand in an array or table of numbers, or in what should be one.

    Else they are sequences of paths, arrays and samples.
    """
    if hasattr(given, "toarray"):  # of SciPy; some are dictionaries, too
        return True
    if isinstance(given, Mapping | Path):
        return False
    if hasattr(given, "columns"):
        named = {*map(str, given.columns)} <= {*modalities}
        return not named and (given.size == 0 or _is_number(given.to_numpy()[0, 0]))
    if isinstance(kind := getattr(getattr(given, "dtype", None), "kind", None), str):
        return given.ndim != 1 or kind not in "OUST"  # an array, or a column of pandas
    if isinstance(given, Sequence) and not isinstance(given, str):
        return len(given) > 0 and _is_number(given[0]) and with_rate(given)[1] is None
    return not isinstance(given, Iterable) or hasattr(given, "__array__")


def _is_number(given: Any) -> bool:  # noqa: ANN401
    return np.isscalar(given) and not isinstance(given, str)


def samples_of(given: Any, modalities: Sequence[str]) -> list[GivenSample]:  # noqa: ANN401
    """Return samples, each with its recordings by modality.

    Args:
        given: Recordings of the only modality: an array (samples, time), (samples, axes, time) or
            (samples, height, width, 3), or a sequence (or column of pandas) of arrays, paths and
            pairs of samples and their rate in Hz. Of several modalities a dictionary of such, one
            dictionary for each sample, or a table of pandas with a column for each modality.
        modalities: Modalities that the model takes.

    Returns:
        For each sample its recordings; None is absent, as NaN and NA of pandas are.

    Raises:
        UserError: If the recordings are of other modalities, not as many of each, or none.
    """
    samples = _as_samples(given, modalities)
    if not samples:
        raise UserError("X holds no recordings; give at least one.")
    return [
        {name: None if _is_missing(one) else one for name, one in sample.items()}
        for sample in samples
    ]


def _is_missing(given: Any) -> bool:  # noqa: ANN401
    """Return whether it is None, or NaN or NA, which pandas has in its place."""
    is_nan = isinstance(given, float) and given != given
    return given is None or is_nan or type(given).__name__ == "NAType"


def _as_samples(given: Any, modalities: Sequence[str]) -> list[GivenSample]:  # noqa: ANN401
    if hasattr(given, "columns"):
        given = {str(name): given[name].tolist() for name in given.columns}
    for name, one in given.items() if isinstance(given, Mapping) else [("X", given)]:
        check_is_list(name, one)
        if with_rate(one)[1] is not None:
            raise UserError(
                f"{name} is a recording and its rate; give a list, of one such pair if it is one."
            )
    if isinstance(given, Mapping):
        return _by_modality({str(name): [*items] for name, items in given.items()}, modalities)
    items = [*given]
    if items and all(isinstance(item, Mapping) for item in items):
        for item in items:
            _check_names(item, modalities)
        return items
    if len(modalities) != 1:
        raise UserError(
            f"This model takes {' and '.join(modalities)}; give them by name, as in "
            f"{{{', '.join(f'{name!r}: […]' for name in modalities)}}}."
        )
    return [{modalities[0]: item} for item in items]


def _by_modality(given: Mapping[str, list[Given]], modalities: Sequence[str]) -> list[GivenSample]:
    _check_names(given, modalities)
    lengths = {name: len(items) for name, items in given.items()}
    if len({*lengths.values()}) > 1:
        told = ", ".join(f"{count} of {name}" for name, count in lengths.items())
        raise UserError(f"Give as many recordings of every modality, not {told}.")
    return [dict(zip(given, items, strict=True)) for items in zip(*given.values(), strict=True)]


def _check_names(given: Mapping[str, Given], modalities: Sequence[str]) -> None:
    if wrong := [str(name) for name in given if name not in modalities]:
        raise UserError(
            f"This model takes {' and '.join(modalities)}, not {listed(wrong)}; name the "
            "recordings so, or choose another model."
        )


def labels_of(y: Any, least: int = 2) -> tuple[Array, list[str]]:  # noqa: ANN401
    """Return the different labels, and the name of each sample's class.

    Args:
        y: (samples,) labels.
        least: How many different ones it takes.

    Raises:
        ValueError: If they cannot be told apart, are too few, or one is missing.
    """
    if y is None:
        raise InvalidInput("Estimator requires y to be passed, but the target y is None.")
    labels = column_or_1d(y, warn=True)
    check_complete("y", y)
    check_classification_targets(labels)
    if isinstance(y, list | tuple):  # of which NumPy makes one text
        texts = {label for label in y if isinstance(label, str)}
        if both := [*texts.intersection(str(x) for x in y if not isinstance(x, str))]:
            raise InvalidInput(f"y holds {both[0]} as text and otherwise; give labels of one type.")
    classes = np.unique(labels)
    if len(classes) < least:
        found = f"There is only one class ({classes[0]})" if len(classes) else "There is no label"
        raise InvalidInput(
            f"{found}, and telling classes apart takes two; give recordings of another."
        )
    if "" in labels_by_name(classes):
        raise InvalidInput("y holds an empty label; give every sample one.")
    if len(labels_by_name(classes)) < len(classes):
        raise InvalidInput(
            f"Of the labels {listed([*map(str, classes)])} some are one name; give other ones."
        )
    return classes, [normal_form(str(label)) for label in labels.tolist()]


def labels_by_name(classes: Array) -> dict[str, Any]:
    """Return the label of each class by the name that the model knows."""
    return {normal_form(str(label)): label for label in classes.tolist()}


def groups_of(groups: Any, samples: Sequence[GivenSample]) -> list[str]:  # noqa: ANN401
    """Return the name of the group of each sample.

    Raises:
        ValueError: If they are not as many, or one is missing.
    """
    check_consistent_length(groups, samples)
    check_complete("groups", groups, ALONE)
    names = [*map(str, np.asarray(groups).tolist())]
    if not all(map(str.strip, names)):
        raise InvalidInput(f"groups holds an empty text; give every sample one{ALONE}.")
    return names


def check_complete(what: str, values: Any, more: str = "") -> None:  # noqa: ANN401
    """Reject labels or groups (samples,) of which one is missing.

    Raises:
        ValueError: If one is, naming its sample.
    """
    if not isinstance(values, list | tuple):  # in lists with text NumPy turns NaN to text
        values = np.asarray(values).tolist()
    for number, value in enumerate(values):
        if _is_missing(value):
            raise InvalidInput(
                f"{what} holds {value} for sample {number}; give every sample one{more}."
            )


def write_samples(
    samples: Sequence[GivenSample],
    labels: Sequence[str],
    groups: Sequence[int | str] | None,
    folder: Path,
) -> Path:
    """Write the recordings that are arrays to a folder, and a manifest of all.

    Args:
        samples: By modality a path, or samples or pixels; None is absent.
        labels: Class name of each sample.
        groups: Group of each sample; None gives each its own, as of files in the folder of a class.
        folder: An existing folder.

    Returns:
        The manifest.

    Raises:
        UserError: If an array is no recording, or a sample has none.
    """
    counts: Counter[str] = Counter()
    rows: list[Recording] = []
    for number, (sample, label) in enumerate(zip(samples, labels, strict=True)):
        group = f"{label}/{counts[label]}" if groups is None else groups[number]
        counts[label] += 1
        with naming(number):
            if all(given is None for given in sample.values()):
                raise UserError("it is missing; give it, or leave out its label, too.")
            rows += write_sample(sample, label, group, folder, number)
    write_manifest(Recordings(tuple(rows)), manifest := folder / MANIFEST)
    return manifest


@contextmanager
def naming(number: int) -> Iterator[None]:
    """Say in the message of a ``UserError`` which recording of X is meant, counted from 0."""
    try:
        yield
    except UserError as error:
        raise UserError(f"Recording {number} of X: {error}") from error


def map_samples(samples: Iterable[GivenSample], use: Callable[[GivenSample], T]) -> Iterator[T]:
    """Yield what a function returns for each sample; a ``UserError`` says for which."""
    for number, sample in enumerate(samples):
        with naming(number):
            result = use(sample)
        yield result


def write_sample(
    sample: GivenSample, label: str, group: int | str, folder: Path, number: int
) -> Iterator[Recording]:
    """Yield the recordings of one sample; arrays are written to files of a folder first.

    Args:
        sample: See :func:`write_samples`.
        label: Class name.
        group: Its group.
        folder: An existing folder.
        number: Of the sample among those of the folder, for the names of files.

    Raises:
        UserError: If an array is no recording.
    """
    for modality, given in sample.items():
        if given is not None:
            samples, rate = with_rate(given)
            path = _file(samples, modality, folder / f"{modality}_{number}")
            yield Recording(label, modality, expanded(path).resolve(), group, rate)


def with_rate(given: Given) -> tuple[Given, float | None]:
    """Return a recording and the rate in Hz of a pair, as SciPy and librosa read sounds.

    The rate comes first or last; of what is no such pair it is None.
    """
    if isinstance(given, tuple) and len(given) == 2:
        for rate, samples in (given, given[::-1]):
            if np.ndim(rate) == 0 < np.ndim(samples) and (
                np.asarray(rate).dtype.kind in "fiu" or isinstance(rate, Fraction | Decimal)
            ):
                return samples, float(rate)
    return given, None


def _file(given: Given, modality: str, place: Path) -> Path:
    """Return the file of a recording, which is written unless it is one."""
    if isinstance(given, str | Path):
        return Path(given)
    array = as_array(given, modality)
    is_photo = modality == "image" or hasattr(given, "getexif")  # of Pillow
    if is_photo or (array.ndim == 3 and array.dtype == np.uint8):
        file = place.with_suffix(".png")
        Image.fromarray(as_pixels(given, modality)).save(file, compress_level=1)
        return file
    if array.ndim > 2:
        raise UserError(
            f"{modality} is an array of {array.dtype} of the shape {array.shape}; give photos as "
            "uint8 (height, width, 3), or as paths, and signals as (axes, samples)."
        )
    file = place.with_suffix(".npy")
    np.save(file, as_trace(given, modality), allow_pickle=False)
    return file
