"""A classifier as one self-contained ONNX file."""

import json
from pathlib import Path
from typing import Any

import torch

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.errors import UserError
from tex_lightning.export.check import Runner
from tex_lightning.export.graph import DRAWS
from tex_lightning.export.metadata import KEY, metadata
from tex_lightning.export.tracing import quiet, trace, untraceable

EXTRA = 'install it with pip install "tex_lightning[export]"'


def make_onnx(classifier: SurfaceClassifier) -> Any:  # noqa: ANN401
    """Return a classifier as ``onnx.ModelProto``.

    Raises:
        UserError: If PyTorch or ONNX has no form of what it consists of, or a package is missing.
    """
    onnx = require("onnx")
    require("onnxscript")
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
            )
            assert program is not None  # as dynamo makes it
            model = program.model_proto
    except Exception as error:  # of the exporter, in many ways
        raise untraceable(classifier, error) from error
    model.metadata_props.add(key=KEY, value=json.dumps(metadata(classifier)))
    if DRAWS in inputs:  # a value that whoever runs it may replace
        default = onnx.numpy_helper.from_array(inputs[DRAWS].numpy(), DRAWS)
        model.graph.initializer.append(default)
    onnx.checker.check_model(model)
    return model


def without_defaults(model: Any) -> Any:  # noqa: ANN401
    """A copy all inputs of which have to be given: ONNX Runtime Web hides those with a default."""
    copy = type(model)()
    copy.CopyFrom(model)
    inputs = {each.name for each in model.graph.input}
    del copy.graph.initializer[:]
    copy.graph.initializer.extend(
        each for each in model.graph.initializer if each.name not in inputs
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


def write_onnx(model: Any, path: Path) -> None:  # noqa: ANN401
    """Write a model to one file, without the notes of where in the code a node comes from."""
    _clear(model.graph)
    path.write_bytes(model.SerializeToString())


def _clear(graph: Any) -> None:  # noqa: ANN401
    for node in graph.node:
        node.ClearField("metadata_props")
        node.ClearField("doc_string")
        for sense in (each.g for each in node.attribute if each.HasField("g")):
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
    names = [each.name for each in session.get_outputs()]
    return lambda inputs: dict(zip(names, session.run(names, dict(inputs)), strict=True))
