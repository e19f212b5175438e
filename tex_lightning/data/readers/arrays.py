"""Recordings that are given in Python as arrays or paths.

Their recordings are written to a folder with a manifest, so that everything after it treats them as
it does the files of others.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from tex_lightning.data.manifest import write_manifest
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.errors import UserError, listed, shorten
from tex_lightning_runtime.samples import as_trace

Given = Any  # a path, samples or pixels that NumPy can read, or a pair of samples and their rate
Sample = Mapping[str, Given]  # by modality; None is absent
MANIFEST = "manifest.csv"


def is_table(given: Any, modalities: Sequence[str]) -> bool:  # noqa: ANN401
    """Return whether recordings stand in an array or table of numbers, or in what should be one.

    Else they are sequences of paths, arrays and samples.
    """
    if hasattr(given, "toarray"):  # of SciPy; some are dictionaries, too
        return True
    if isinstance(given, Mapping):
        return False
    if hasattr(given, "columns"):
        named = {*map(str, given.columns)} <= {*modalities}
        return not named and (given.size == 0 or _is_number(given.to_numpy()[0, 0]))
    if isinstance(kind := getattr(getattr(given, "dtype", None), "kind", None), str):
        return given.ndim != 1 or kind not in "OUS"  # an array, or a column of pandas
    if isinstance(given, Sequence) and not isinstance(given, str):
        return not given or _is_number(given[0])
    return not isinstance(given, Iterable) or hasattr(given, "__array__")


def _is_number(given: Any) -> bool:  # noqa: ANN401
    return np.isscalar(given) and not isinstance(given, str)


def samples_of(given: Any, modalities: Sequence[str]) -> list[Sample]:  # noqa: ANN401
    """Return samples, each with its recordings by modality.

    Args:
        given: Recordings of the only modality: an array (samples, time), (samples, axes, time) or
            (samples, height, width, 3), or a sequence (or column of pandas) of arrays, paths and
            pairs of samples and their rate in Hz. Of several modalities a dictionary of such, one
            dictionary for each sample, or a table of pandas with a column for each modality.
        modalities: Modalities that the model takes.

    Raises:
        UserError: If the recordings are of other modalities, or not as many of each.
    """
    if hasattr(given, "columns"):
        given = {str(name): given[name].tolist() for name in given.columns}
    if isinstance(given, str | Path):
        raise UserError(f"X is {shorten(given)}; give a list, of one path if there is one.")
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


def _by_modality(given: Mapping[str, list[Given]], modalities: Sequence[str]) -> list[Sample]:
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


def write_samples(
    samples: Sequence[Sample],
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
        UserError: If an array is no recording.
    """
    counts: Counter[str] = Counter()
    rows: list[Recording] = []
    for number, (sample, label) in enumerate(zip(samples, labels, strict=True)):
        group = f"{label}/{counts[label]}" if groups is None else groups[number]
        counts[label] += 1
        rows += write_sample(sample, label, group, folder, number)
    write_manifest(Recordings(tuple(rows)), manifest := folder / MANIFEST)
    return manifest


def write_sample(
    sample: Sample, label: str, group: int | str, folder: Path, number: int
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
            yield Recording(label, modality, path.expanduser().resolve(), group, rate)


def with_rate(given: Given) -> tuple[Given, float | None]:
    """Return a recording and the rate in Hz of a pair, as SciPy and librosa read sounds.

    The rate comes first or last; of what is no such pair it is None.
    """
    if isinstance(given, tuple) and len(given) == 2:
        for rate, samples in (given, given[::-1]):
            if np.ndim(rate) == 0 and np.ndim(samples) > 0 and not isinstance(rate, str | Path):
                return samples, float(rate)
    return given, None


def _file(given: Given, modality: str, place: Path) -> Path:
    """Return the file of a recording, which is written unless it is one."""
    if isinstance(given, str | Path):
        return Path(given)
    array = np.asarray(given)
    if array.ndim != 3 and modality != "image":
        file = place.with_suffix(".npy")
        np.save(file, as_trace(given, modality), allow_pickle=False)
        return file
    if array.dtype != np.uint8 or array.ndim not in (2, 3) or array.shape[2:] not in ((), (3,)):
        raise UserError(
            f"{modality} is an array of {array.dtype} of the shape {array.shape}; give photos as "
            "uint8 (height, width, 3), or as paths, and signals as (axes, samples)."
        )
    file = place.with_suffix(".png")
    Image.fromarray(array).save(file, compress_level=1)
    return file
