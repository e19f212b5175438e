"""The network of an exported file, with everything from recordings to a label around it."""

import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tex_lightning_runtime.errors import UserError, require
from tex_lightning_runtime.files import as_photo, as_trace, read_photo, read_trace
from tex_lightning_runtime.quality import halve, photo_quality, trace_quality
from tex_lightning_runtime.resampling import Array, Resampler
from tex_lightning_runtime.voting import join, vote

FORMAT = 1  # of the file's metadata
FATAL = 4  # severity of what ONNX Runtime logs
UNLIKE = 0.5  # of votes and probabilities that is spread where an input is unlike the training


class Decoded(NamedTuple):
    """Input of the graph, content that seeds, what is wrong, whether nothing was measured."""

    array: Array
    content: Array
    warnings: list[str]
    empty: bool


class Runtime:
    """Classify as ``task=predict`` does with the checkpoint that ``task=export`` was given.

    Args:
        path: The ``.onnx`` file; :attr:`card` is what it says of itself.
        top_k: How many classes a prediction lists.
        threads: Of the arithmetic; 0 takes all cores.

    Raises:
        UserError: If the file cannot be used; all methods do where an input cannot.
    """

    def __init__(self, path: str | Path, *, top_k: int = 3, threads: int = 0) -> None:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads, options.log_severity_level = threads, FATAL
        # threads that wait in a loop take the processor from whatever else the machine does
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        try:
            found = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
            self.card = json.loads(found.get_modelmeta().custom_metadata_map["tex_lightning"])
        except Exception as error:  # they have no class in common
            raise UserError(f"Model {path} is missing, or no file of task=export.") from error
        fits = self.card["format"] == FORMAT
        require(fits, f"Model {path} has another format; update tex_lightning_runtime.")
        self._session, self._top_k = found, top_k

    def predict(self, *, rate: float | None = None, **recordings: Any) -> dict[str, Any]:
        """Classify one sample.

        Args:
            rate: In Hz, of samples and of files that carry none; None takes the card's.
            **recordings: By modality a file, samples (axes, samples) or pixels (height, width, 3).
        """
        begin, given = time.perf_counter(), recordings.items()
        decoded = {name: self.decode(name, it, rate) for name, it in given if it is not None}
        found = self.decide(decoded, begin)
        every = [each for each in map(self.sense, decoded) if each["medium"] == "signal"]
        least = [f"{each['least'] / each['rate']:.2f} s" for each in every if each["least"]]
        said = f"There is less movement than the {' and '.join(least)} that one fragment takes"
        require(found["fragments"], f"{said}; record a longer stroke.")
        return found

    def stream(self, window: float | None = None, **given: Any) -> "Stream":
        """Begin a recording that is classified as it goes on; see :class:`Stream`."""
        return Stream(self, window, **given)

    def sense(self, modality: str) -> dict[str, Any]:
        """What the card says of a modality."""
        found = [each for each in self.card["senses"] if each["modality"] == modality]
        require(
            found, f"This {self.card['kind']} network does not look at {modality}; leave it out."
        )
        return {**found[0], "ranges": self.card["ranges"].get(modality, {})}

    def decode(self, modality: str, given: Any, rate: float | None = None) -> Decoded:
        """Bring a file or array to what the graph takes."""
        sense = self.sense(modality)
        path = Path(given).expanduser() if isinstance(given, str | Path) else None
        if sense["medium"] == "signal":
            if path:
                raw, own = read_trace(path, sense["channel"], rate)
                rate = sense["file_rate"] if own is None else own
            else:
                raw, rate = as_trace(given, modality), sense["rate"] if rate is None else rate
            return as_signal(sense, raw, Resampler(rate, sense["rate"])(raw), rate)
        photo = read_photo(path) if path else as_photo(given, modality)
        width, height = (side // (1 + sense["half_scale"]) for side in photo.shape[1::-1])
        said = (
            f"The {sense['what']} has {width}x{height} pixels after decoding; use one of at least "
        )
        require(min(width, height) >= (sense["least"] or 1), f"{said}{sense['least']} a side.")
        seeds = len(self.card["senses"]) > 1 and sense["half_scale"]
        return Decoded(photo, halve(photo) if seeds else photo, *photo_quality(photo, sense))

    def decide(self, decoded: Mapping[str, Decoded], begin: float) -> dict[str, Any]:
        """Vote over decoded recordings by modality; ``begin`` is when their decoding began."""
        card, rules = self.card, self.card["decision"]
        senses = [sense for sense in card["senses"] if sense["modality"] in decoded]
        whole, least = len(senses) == len(card["senses"]), rules["reject_below"]
        needs = " and ".join(f"{each['modality']}=FILE" for each in card["senses"])
        require(senses and (whole or card["parts"]), f"This network needs {needs}; give them all.")
        inputs = {each["modality"]: decoded[each["modality"]] for each in senses}
        unknown, names = (
            card["unknown"] if whole else None,
            [f"{it['name']}_scores" for it in senses],
        )
        found = self._compute(["novelty", *names] if unknown else names, inputs)
        warnings = [warning for each in inputs.values() for warning in each.warnings]
        empty = all(each.empty for each in inputs.values())
        doubt = 1.0 if empty else UNLIKE if warnings else 0.0
        said: dict[str, Any] = dict.fromkeys(("label", "rejected", "probability", "confidence"))
        said |= {"rejected": False, "top_k": [], "fragments": 0}
        said |= {"relative_macs": 1.0, "warnings": warnings, "modalities": [*inputs]}
        if found:
            scores = join(found[-len(names) :], [each.content for each in inputs.values()], rules)
            best, *both = vote(scores, rules["rule"], rules["temperature"] if whole else 1.0)
            shares, probabilities = ((1 - doubt) * each + doubt / len(each) for each in both)
            ranked = sorted(range(len(shares)), key=lambda i: (i != best, -shares[i], i))
            top = [{"label": card["classes"][i], "share": float(shares[i])} for i in ranked]
            said |= {**top[0], "probability": float(probabilities[best])}
            said |= {"confidence": said.pop("share"), "fragments": scores.shape[1]}
            said["top_k"] = top[: self._top_k]
            if said["probability"] < (least or 0) or (empty and least):
                said |= {"label": None, "rejected": True}
            if unknown and (empty or found[0] > unknown["threshold"]):
                said |= {"label": "unknown", "rejected": True}
        if least is None and not unknown:
            del said["rejected"]
        if len(card["senses"]) == 1:
            del said["modalities"]
        said["latency_ms"] = round((time.perf_counter() - begin) * 1000, 3)
        return said | ({"novelty": float(found[0])} if unknown and found else {})

    def _compute(self, outputs: list[str], inputs: Mapping[str, Decoded]) -> list[Array]:
        """Outputs of the graph; none if a signal is too short for its convolutions."""
        feed = {name: each.array for name, each in inputs.items()}
        for sense in self.card["senses"]:  # the least that there can be, of what is not there
            size, signal = (sense["least"] or 1), sense["medium"] == "signal"
            side = size * (1 + sense.get("half_scale", False))
            blank = np.zeros((1, size) if signal else (side, side, 3), np.uint8)
            feed.setdefault(sense["modality"], blank.astype(np.float32) if signal else blank)
        try:
            found = list(self._session.run(outputs, feed))
        except Exception:  # of ONNX Runtime, whose classes do not tell what it is
            if not any(self.sense(name)["medium"] == "signal" for name in inputs):
                raise
            return []
        return found if all(each.size for each in found) else []


class Stream:
    """A recording that goes on: predict from all samples so far, or from the last seconds.

    Args:
        runtime: Predicts.
        window: How many seconds; None takes all.
        rate: Of the samples in Hz; None is the network's.
        **photos: By modality, as :meth:`Runtime.predict` takes them; they stay as they are.
    """

    def __init__(
        self, runtime: Runtime, window: float | None, *, rate: float | None = None, **photos: Any
    ) -> None:
        self._runtime, self._window, self._rate = runtime, window, rate
        self._decoded = {name: runtime.decode(name, photo) for name, photo in photos.items()}
        self._raw: dict[str, Array] = {}
        self._settled: dict[str, Array] = {}  # at the network's rate, changed by no later sample

    def push(self, samples: Any = None, /, **chunks: Any) -> dict[str, Any]:
        """Take more samples (axes, samples), of several signals by modality, and predict.

        The label is None while there is not one fragment.
        """
        begin, senses = time.perf_counter(), self._runtime.card["senses"]
        signals = [each["modality"] for each in senses if each["medium"] == "signal"]
        if samples is not None:
            require(len(signals) == 1, f"Give the samples by name: {', '.join(signals)}.")
            chunks = {signals[0]: samples}
        for name, chunk in chunks.items():
            self._decoded[name] = self._take(name, as_trace(chunk, name))
        return self._runtime.decide(self._decoded, begin)

    def _take(self, name: str, chunk: Array) -> Decoded:
        sense = self._runtime.sense(name)
        rate = sense["rate"] if self._rate is None else self._rate
        raw = self._raw.get(name, chunk[:, :0])
        require(len(raw) == len(chunk), f"{name} had {len(raw)} axes before; give as many.")
        raw = np.concatenate((raw, chunk), axis=1)
        known = self._settled.get(name, np.empty((len(raw), 0), np.float32))
        if self._window is not None:
            raw, known = raw[:, -max(1, round(self._window * rate)) :], known[:, :0]
        resample = Resampler(rate, sense["rate"])
        trace = np.concatenate((known, resample(raw, known.shape[1])), axis=1)
        self._raw[name], self._settled[name] = raw, trace[:, : resample.settled(raw.shape[1])]
        return as_signal(sense, raw, trace, rate)


def as_signal(sense: Mapping[str, Any], raw: Array, trace: Array, rate: float) -> Decoded:
    """What the graph takes of samples (axes, samples), before and after resampling."""
    require(len(raw) in sense["axes"], f"This file is for {sense['axes']} axes, not {len(raw)}.")
    return Decoded(trace, trace, *trace_quality(raw, trace, rate, sense))
