"""The network of an exported file, with everything from recordings to a prediction around it."""

import json
import logging
import time
from collections.abc import Iterable
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tex_lightning_runtime.errors import UserError, require
from tex_lightning_runtime.files import expanded
from tex_lightning_runtime.photos import read_photo
from tex_lightning_runtime.pixels import as_pixels, halve, middle
from tex_lightning_runtime.quality import (
    Quality,
    level,
    photo_quality,
    together,
    trace_measures,
    trace_quality,
)
from tex_lightning_runtime.resampling import to_rate
from tex_lightning_runtime.samples import Array, as_trace, check_samples, content_seed
from tex_lightning_runtime.traces import read_samples

log = logging.getLogger(__name__)
REMEDY = "the rate where the file has none; a column of time in milliseconds is called time_ms"

FORMAT = 2  # of the metadata of an exported file
FATAL = 4  # severity of what ONNX Runtime logs
MAX_PAIRS = 1_000_000  # of fragments that several senses vote over


class Decoded(NamedTuple):
    """Input of the graph, what seeds its tuples, and its faults."""

    array: Array
    content: Array
    quality: Quality


class Raw(NamedTuple):
    """Samples (axes, samples) as they came, their rate in Hz, and what messages call them."""

    samples: Array
    rate: float
    name: str


class Runtime:
    """Classify as ``task=predict`` does with the checkpoint that ``task=export`` was given.

    A prediction lists ``top_k`` classes; 0 ``threads`` take all cores. :attr:`card` is what the
    ``.onnx`` file says of itself. All methods raise :class:`UserError` of what they cannot use.
    """

    def __init__(self, path: str | Path, *, top_k: int = 3, threads: int = 0) -> None:
        import onnxruntime as ort

        options = ort.SessionOptions()
        options.intra_op_num_threads, options.log_severity_level = threads, FATAL
        # threads that wait in a loop take the processor from whatever else the machine does
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        try:
            require(Path(path).is_file(), "it is no file")
            with redirect_stdout(None):  # it prints what it then raises
                found = ort.InferenceSession(path, options, providers=["CPUExecutionProvider"])
            self.card = json.loads(found.get_modelmeta().custom_metadata_map["tex_lightning"])
            fits = self.card["format"] == FORMAT
            pairs, seed = (self.card["decision"][key] for key in ("pairs", "seed"))
            whole = isinstance(pairs, int) and isinstance(seed, int)
            bounded = whole and 1 <= pairs <= MAX_PAIRS and 0 <= seed < 1 << 32
        except Exception as error:  # they have no class in common
            raise UserError(f"Model {path} is missing, or no file of task=export.") from error
        require(fits, f"Model {path} has another format; export it anew.")
        require(bounded, f"Model {path} draws {pairs} pairs from {seed}; export it anew.")
        self.senses = {each["modality"]: each for each in self.card["senses"]}
        self._session, self._top_k, self._path = found, top_k, path

    def predict(self, *, rate: float | None = None, **recordings: Any) -> dict[str, Any]:
        """Classify one sample: by modality a file, samples (axes, samples) or pixels (M, N, 3).

        The ``rate`` in Hz is that of samples, and of files that carry none; None takes the card's.
        """
        begin, given = time.perf_counter(), recordings.items()
        senses = [(self.sense(name), each) for name, each in given if each is not None]
        decoded = {s["modality"]: decode(each, s, rate) for s, each in senses}
        found = self.decide(decoded, begin)
        signals = [s for s, _ in senses if "rate" in s]
        short = [s for s in signals if _lacks(s, decoded[s["modality"]].array)]
        require(found["fragments"], " ".join(s["too_short"] for s in short or signals))
        return found

    def stream(self, window: float | None = None, **given: Any) -> "Stream":
        """Begin a recording whose last ``window`` seconds count, or all; see :class:`Stream`."""
        return Stream(self, window, **given)

    def sense(self, modality: str) -> dict[str, Any]:
        """What the card says of a modality."""
        require(modality in self.senses, f"The network does not look at {modality}; leave it out.")
        return dict(self.senses[modality])

    def decide(self, decoded: dict[str, Decoded], begin: float) -> dict[str, Any]:
        """Predict from decoded recordings by modality; ``begin`` is when their decoding began."""
        inputs = {name: decoded[name] for name in self.senses if name in decoded}
        absent = " and ".join(name for name in self.senses if name not in decoded)
        require(not absent, f"The network needs {' and '.join(self.senses)}; give {absent} too.")
        found, quality = self._run(inputs), together(each.quality for each in inputs.values())
        judges, classes = self.card["unknown"] is not None, self.card["classes"]
        said: dict[str, Any] = {"label": None, "rejected": False, "probability": None}
        said |= {"confidence": None, "top_k": [], "fragments": 0, "relative_macs": 1.0}
        said |= {"warnings": [*quality.warnings], "modalities": [*inputs]}
        if found:
            doubt, best = quality.doubt, int(found["label"])
            both = found["shares"], found["probabilities"]
            shares, probabilities = ((1 - doubt) * each + doubt / len(each) for each in both)
            by_votes = self.card["decision"]["rule"] == "vote"
            support = shares if by_votes else probabilities  # what has decided
            order = np.lexsort((-probabilities, -support, np.arange(len(classes)) != best))
            top = [{"label": classes[i], "share": float(support[i])} for i in order.tolist()]
            said |= {"probability": float(probabilities[best]), "confidence": top[0]["share"]}
            said |= {"top_k": top[: self._top_k], "fragments": found["scores"].shape[1]}
            said["rejected"] = judges and bool(quality.empty or found["unknown"])
            said["label"] = "unknown" if said["rejected"] else top[0]["label"]
        if not judges:
            del said["rejected"]
        if len(self.senses) == 1:
            del said["modalities"]
        said["latency_ms"] = round((time.perf_counter() - begin) * 1000, 3)
        said |= {"novelty": float(found["novelty"])} if found and judges else {}
        all_of_them = zip(classes, probabilities.tolist(), strict=True) if found else ()
        return said | {"probabilities": dict(all_of_them)}

    def _run(self, inputs: dict[str, Decoded]) -> dict[str, Array]:
        """Outputs of the graph by name; none if a signal is too short for one fragment."""
        feed = {name: each.array for name, each in inputs.items()}
        if any(_lacks(self.senses[name], each) for name, each in feed.items()):
            return {}
        if len(self.card["senses"]) > 1:  # else there are no tuples to draw
            given, pairs = self.card["decision"]["seed"], self.card["decision"]["pairs"]
            seed = content_seed(given, *(each.content for each in inputs.values()))
            words = np.random.RandomState(seed).bytes(4 * pairs * len(self.card["senses"]))
            feed["draws"] = np.frombuffer(words, "<u4").reshape(-1, pairs).T.astype(np.int64)
        names = [each.name for each in self._session.get_outputs()]
        try:
            found = dict(zip(names, self._session.run(names, feed), strict=True))
        except Exception as error:  # of ONNX Runtime, whose classes do not tell what it is
            short = any("rate" in self.senses[name] for name in inputs)
            said = " ".join(str(error).split())[:200]
            require(short and "alloc" not in said, f"It cannot be computed ({said}); give less.")
            return {}
        scores = [found[f"{self.senses[name]['name']}_scores"] for name in inputs]
        finite = all(bool(np.isfinite(each).all()) for each in scores)
        require(finite, f"Model {self._path} computes NaN, so it is damaged; export it anew.")
        return found if all(each.size for each in scores) else {}


def _lacks(sense: dict[str, Any], array: Array) -> bool:
    """Return whether it is a signal that is too short for one fragment, movement or not."""
    return "rate" in sense and array.shape[1] < (sense["least"] or 1)


class Stream:
    """A recording that goes on, with samples of a ``rate`` in Hz; photos stay as they are."""

    def __init__(
        self, runtime: Runtime, window: float | None, *, rate: float | None = None, **photos: Any
    ) -> None:
        self._runtime, self._window, self._rate = runtime, window, rate
        self._decoded = {name: decode(each, runtime.sense(name)) for name, each in photos.items()}
        self._raw: dict[str, Array] = {}

    def push(self, samples: Any = None, /, **chunks: Any) -> dict[str, Any]:
        """Predict with more samples (axes, samples), by modality or of the first signal."""
        begin, senses = time.perf_counter(), self._runtime.senses
        if samples is not None:
            chunks[next(name for name, each in senses.items() if "rate" in each)] = samples
        for name, chunk in chunks.items():
            sense = self._runtime.sense(name)
            new, rate, title = read_trace(chunk, sense, self._rate, is_chunk=True)
            raw = self._raw.get(name, new[:, :0])
            require(len(raw) == len(new), f"{name} had {len(raw)} axes before; give as many.")
            kept = 0 if self._window is None else -max(1, round(self._window * rate))
            self._raw[name] = np.concatenate((raw, new), axis=1)[:, kept:]
            self._decoded[name] = assess(Raw(self._raw[name], rate, title), sense)
        return self._runtime.decide(self._decoded, begin)


def decode(given: Any, sense: dict[str, Any], rate: float | None = None) -> Decoded:
    """Bring a file, samples (axes, samples) or pixels to what a sense of the card takes."""
    if sense["medium"] == "photo":
        return _photo(given, sense)
    return assess(read_trace(given, sense, rate), sense)


def read_trace(
    given: Any, sense: dict[str, Any], rate: float | None, *, is_chunk: bool = False
) -> Raw:
    """Read samples, whose rate is that of the file, ``rate``, or the card's.

    The longer dimension is time, unless they are a chunk of a stream.
    """
    if not isinstance(given, str | Path):
        name = f"The {sense['what']}"
        samples = as_trace(given, name, sense["channels"], is_chunk=is_chunk)
        return Raw(samples, sense["rate"] if rate is None else rate, name)
    path, usual = expanded(given), sense["file_rate"] if rate is None else rate
    samples, own, reading = read_samples(path, sense["channels"], sense.get("time_unit"))
    check_samples(samples, name := f"Trace {path}")
    _tell(path, reading.notes)
    return Raw(samples, usual if own is None else own, name)


def assess(raw: Raw, sense: dict[str, Any]) -> Decoded:
    """Resample a signal to what a sense of the card takes, and judge it."""
    axes, target = len(raw.samples), sense["rate"]
    require(axes in sense["axes"], f"Give a trace of {sense['axes']} axes, not {axes}.")
    trace = to_rate(raw.samples, raw.rate, target, raw.name, REMEDY)
    measures = trace_measures(level(trace), raw.rate, target)
    quality = trace_quality(raw.samples, sense["limits"], sense["what"], measures)
    return Decoded(trace, trace, quality)


def _photo(given: Any, sense: dict[str, Any]) -> Decoded:
    what, name, least = sense["what"], f"The {sense['what']}", sense["least"] or 1
    if isinstance(given, str | Path):
        path = expanded(given)
        name = f"Image {path}"
        photo, notes = read_photo(path)
        _tell(path, notes)
    else:
        photo = as_pixels(given, name)
    photo = middle(photo, 2 if sense["half_scale"] else 1, name)
    seen = halve(photo) if sense["half_scale"] else photo
    side, said = min(seen.shape[:2]), f"The {what} has {seen.shape[1]}x{seen.shape[0]} pixels"
    require(side >= least, f"{said} after decoding; use one of at least {least} a side.")
    return Decoded(photo, seen, photo_quality(seen, sense["limits"], what))


def _tell(path: Path, notes: Iterable[str]) -> None:
    """Say of a file what is no fault of its content."""
    for note in notes:
        log.warning("%s: %s.", path, note)
