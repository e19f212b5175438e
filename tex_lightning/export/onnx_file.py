"""A classifier as one self-contained ONNX file, compared with it on recordings of noise."""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from statistics import median
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.core.progress import track
from tex_lightning.data.decode import PhotoDecoder
from tex_lightning.errors import UserError
from tex_lightning.export.graph import DRAWS
from tex_lightning.export.metadata import METADATA_KEY, metadata
from tex_lightning.export.tracing import axes_of, draws, example, quiet, trace, untraceable
from tex_lightning.senses.features.proportions import BandProportions

Array = npt.NDArray[Any]
TensorSample = dict[str, Tensor]  # recordings by modality, as a file takes them
Runner = Callable[[Mapping[str, Array]], Mapping[str, Array]]  # inputs to outputs, by name
EXTRA = 'install it with pip install "tex_lightning[export]"'


def make_onnx(classifier: SurfaceClassifier) -> Any:  # noqa: ANN401
    """Return a classifier as ``onnx.ModelProto``.

    Raises:
        UserError: If PyTorch or ONNX has no form of what it consists of, or a package is missing.
    """
    onnx, script = require("onnx"), require("onnxscript").optimizer
    traced, inputs, outputs = trace(classifier)
    try:
        with quiet():
            program = torch.onnx.export(
                traced,
                input_names=list(inputs),
                output_names=outputs,
                dynamo=True,
                external_data=False,
                verbose=False,
                optimize=False,  # takes x + 1e-9 for x, and so log(x + 1e-9) of silence for log(0)
            )
            assert program is not None  # as dynamo makes it
            script.inline(program.model)
            script.fold_constants(program.model, onnx_shape_inference=True)
            script.remove_unused_nodes(program.model)
            model = program.model_proto
    except Exception as error:  # of the exporter, in many ways
        raise untraceable(classifier, error) from error
    model.metadata_props.add(key=METADATA_KEY, value=json.dumps(metadata(classifier)))
    if DRAWS in inputs:  # a value that whoever runs it may replace
        default = onnx.numpy_helper.from_array(inputs[DRAWS].numpy(), DRAWS)
        model.graph.initializer.append(default)
    onnx.checker.check_model(model)
    return model


def without_defaults(model: Any) -> Any:  # noqa: ANN401
    """Return a copy that needs all inputs: ONNX Runtime Web hides those with a default."""
    copy = type(model)()
    copy.CopyFrom(model)
    inputs = {value.name for value in model.graph.input}
    del copy.graph.initializer[:]
    copy.graph.initializer.extend(
        value for value in model.graph.initializer if value.name not in inputs
    )
    return copy


def require(name: str) -> Any:  # noqa: ANN401
    """Import a package of the extra ``export``.

    Raises:
        UserError: If it is not installed.
    """
    try:
        return __import__(name, fromlist=["_"])
    except ImportError as error:
        raise UserError(f"This needs {name}, which is not installed; {EXTRA}.") from error


def onnx_bytes(model: Any) -> bytes:  # noqa: ANN401
    """Return the file of a model, without the notes of where in the code a node comes from."""
    _clear(model.graph)
    content: bytes = model.SerializeToString()
    return content


def _clear(graph: Any) -> None:  # noqa: ANN401
    for node in graph.node:
        node.ClearField("metadata_props")
        node.ClearField("doc_string")
        for sense in (attribute.g for attribute in node.attribute if attribute.HasField("g")):
            _clear(sense)
    for value in (*graph.value_info, *graph.input, *graph.output):
        value.ClearField("metadata_props")
    graph.ClearField("metadata_props")


ERRORS_ONLY = 3  # of onnxruntime's levels: it warns of every input that has a default


def onnx_runner(model: Any) -> Runner:  # noqa: ANN401
    """Return a function that runs a model, given as ``onnx.ModelProto``."""
    runtime = require("onnxruntime")
    options = runtime.SessionOptions()
    options.intra_op_num_threads = torch.get_num_threads()
    options.log_severity_level = ERRORS_ONLY
    session = runtime.InferenceSession(
        model.SerializeToString(), options, providers=["CPUExecutionProvider"]
    )
    names = [output.name for output in session.get_outputs()]
    return lambda inputs: dict(zip(names, session.run(names, dict(inputs)), strict=True))


SHORTEST = 0.5  # of the example that is traced
TOLERANCE = 1e-4  # of the range of a recording's scores
# The same where comparisons are counted: a few of thousands fall the other way by rounding, above
# all on training recordings, whose values the thresholds are. Against float64 PyTorch errs alike.
COUNTED = 0.05


def noise_sample(classifier: SurfaceClassifier, seed: int) -> TensorSample:
    """Draw recordings of random sizes, as strong as those of the training.

    Every second signal begins with quiet and a touch.
    """
    rng, recordings = np.random.default_rng(seed), {}
    for sense in classifier.senses.values():
        noise = example(sense, seed)
        if sense.medium == "signal":
            axes = axes_of(sense)[0 if seed % 4 < 2 else -1]
            samples = round(noise.shape[1] * rng.uniform(SHORTEST, 2))
            level = classifier.card.input_ranges.get(sense.modality, {}).get("level", [1.0])
            noise = noise.repeat(1, 2)[:axes, :samples] * level[-1]  # far from it little counts
            if seed % 2:
                noise[:, : noise.shape[1] // 10] *= 1e-3
        else:
            height, width = noise.shape[:2]
            noise = noise.repeat(2, 2, 1)[: height + int(rng.integers(height)), : width + seed]
        recordings[sense.modality] = noise.contiguous()
    return recordings


def decoded(sample: TensorSample, classifier: SurfaceClassifier) -> TensorSample:
    """Return the recordings as the classifier takes them: photos are halved."""
    result = dict(sample)
    for sense in classifier.senses.values():
        if isinstance(sense.decoder, PhotoDecoder):
            photo = sense.decoder.scale(sample[sense.modality].numpy(), "The photo")
            result[sense.modality] = torch.from_numpy(photo)
    return result


def compare(
    runner: Runner, classifier: SurfaceClassifier, samples: Sequence[TensorSample]
) -> dict[str, Any]:
    """Run a file and its classifier on the same recordings.

    Returns:
        Number of ``recordings`` and ``same_labels``; largest ``score_difference``, as a share of
        its recording's range, and ``probability_difference``; ``latency_ms``, the median from
        decoded recordings to the label of the file, None without recordings.
    """
    same, scores, shares, times = 0, [0.0], [0.0], []
    for sample in track(samples, "checking recording"):
        recordings = decoded(sample, classifier)
        inputs = feed(classifier, sample, recordings)
        with torch.inference_mode():
            expected = classifier.logits(**recordings)
            vote = classifier.decide(expected, classifier.card.temperature)
        begin = time.perf_counter()
        try:
            outputs = runner(inputs)
        except Exception as error:  # of the file, as of a network whose form holds for one length
            raise untraceable(classifier, error) from error
        times.append(time.perf_counter() - begin)
        wide = expected.double().numpy()
        scores.append(float(np.abs(outputs["scores"] - wide).max() / max(np.ptp(wide), 1e-12)))
        shares.append(float(np.abs(outputs["probabilities"] - vote.probabilities.numpy()).max()))
        same += int(outputs["label"]) == vote.label
    return {
        "recordings": len(samples),
        "same_labels": same,
        "score_difference": max(scores),
        "probability_difference": max(shares),
        "latency_ms": 1000 * median(times) if times else None,
    }


def feed(
    classifier: SurfaceClassifier, sample: TensorSample, recordings: TensorSample
) -> dict[str, Array]:
    """Return the inputs of a file by name, so that a FusionNet draws the classifier's tuples."""
    inputs = {name: np.ascontiguousarray(recording.numpy()) for name, recording in sample.items()}
    if classifier.fusion is not None:
        card, seed = classifier.card, classifier.seed(**recordings)
        inputs[DRAWS] = draws(seed, card.decision["pairs"], len(card.sense_names)).numpy()
    return inputs


def require_agreement(agreement: Mapping[str, Any], classifier: SurfaceClassifier) -> None:
    """Raise an error if a file disagrees with its classifier by more than rounding.

    Raises:
        UserError: Saying how much.
    """
    senses = classifier.senses.values()
    counts = any(isinstance(sense.features, BandProportions) for sense in senses)
    allowed = COUNTED if counts else TOLERANCE
    wrong = agreement["recordings"] - agreement["same_labels"]
    if wrong or agreement["score_difference"] > allowed:
        raise UserError(
            f"The exported file gives another label for {wrong} of {agreement['recordings']} "
            f"recordings and scores that differ by {agreement['score_difference']:.2g} of their "
            f"range, where {allowed:g} is allowed; it was not written. Set export.check=0 to leave "
            "the check out, or report this network."
        )
