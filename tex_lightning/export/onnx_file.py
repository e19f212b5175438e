"""A classifier as one self-contained ONNX file, which computes only the senses it is given."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.errors import UserError
from tex_lightning.export.check import Runner
from tex_lightning.export.graph import DRAWS, is_public, sense_outputs
from tex_lightning.export.metadata import KEY, metadata
from tex_lightning.export.tracing import Traced, quiet, untraceable


def skip_absent(model: Any, senses: Mapping[str, Sequence[str]], outputs: Sequence[str]) -> Any:  # noqa: ANN401
    """Copy a model so that it takes an input without elements in place of an absent recording.

    What a sense computes stands in the branch of an ``If`` on the size of its input. The other
    branch gives zeros, of size 0 along every axis whose size is open.

    Args:
        model: ``onnx.ModelProto``.
        senses: By each input that may be absent, those of the outputs that depend on it alone.
        outputs: Which outputs the copy has.
    """
    import onnx.utils

    tools = onnx.utils.Extractor(model)
    inputs = [each.name for each in model.graph.input]
    told = [value for values in senses.values() for value in values]
    found = tools.extract_model([*inputs, *told], list(outputs))
    nodes = []
    for recording, values in senses.items():
        size, present = f"{recording}/size", f"{recording}/present"
        branches = {"then_branch": _computed(tools, recording, values),
                    "else_branch": _zeros(tools, recording, values)}  # fmt: skip
        nodes += [
            onnx.helper.make_node("Size", [recording], [size]),
            onnx.helper.make_node("Cast", [size], [present], to=onnx.TensorProto.BOOL),
            onnx.helper.make_node("If", [present], values, **branches),
        ]
    nodes += found.graph.node
    del found.graph.node[:], found.graph.input[len(inputs) :]
    found.graph.node.extend(nodes)
    return found


def _computed(tools: Any, recording: str, values: Sequence[str]) -> Any:  # noqa: ANN401
    """The graph of a sense, which reads its input from the graph around it."""
    from onnx.compose import add_prefix_graph

    graph = tools.extract_model([recording], values).graph
    del graph.input[:], graph.value_info[:]
    return add_prefix_graph(graph, f"{recording}/", rename_inputs=False)


def _zeros(tools: Any, recording: str, values: Sequence[str]) -> Any:  # noqa: ANN401
    """The graph of what stands for an absent sense."""
    from onnx import helper, numpy_helper

    nodes, outputs = [], []
    for value in values:
        name, each = f"{recording}/no/{value}", tools.value_infos[value].type.tensor_type
        shape = [size.dim_value for size in each.shape.dim]  # 0 where it is open
        zeros = np.zeros(shape, helper.tensor_dtype_to_np_dtype(each.elem_type))
        nodes.append(helper.make_node("Constant", [], [name], value=numpy_helper.from_array(zeros)))
        outputs.append(helper.make_tensor_value_info(name, each.elem_type, shape))
    return helper.make_graph(nodes, f"no {recording}", [], outputs)


EXTRA = 'install it with pip install "tex_lightning[export]"'


def make_onnx(classifier: SurfaceClassifier, traced: Traced) -> Any:  # noqa: ANN401
    """The model, as ``onnx.ModelProto``; a FusionNet's takes samples that lack a sense.

    Raises:
        UserError: If an operation has no form in ONNX, or a package is missing.
    """
    onnx = require("onnx")
    require("onnxscript")
    try:
        with quiet():
            program = torch.onnx.export(
                traced.program,
                input_names=list(traced.inputs),
                output_names=traced.outputs,
                dynamo=True,
                external_data=False,
                verbose=False,
            )
            assert program is not None  # as dynamo makes it
            model = program.model_proto
    except Exception as error:  # of the exporter, in many ways
        raise untraceable(classifier, error) from error
    model.metadata_props.add(key=KEY, value=json.dumps(metadata(classifier)))
    if DRAWS in traced.inputs:  # a value that whoever runs it may replace
        default = onnx.numpy_helper.from_array(traced.inputs[DRAWS].numpy(), DRAWS)
        model.graph.initializer.append(default)
    if classifier.fusion is not None:  # every sense only where it is not absent
        outputs = [each.name for each in model.graph.output]
        senses: dict[str, list[str]] = {}
        for name, sense in classifier.senses.items():
            own = [output for output in sense_outputs(name) if output in outputs]
            senses.setdefault(sense.modality, []).extend(own)
        found = skip_absent(model, senses, [name for name in outputs if is_public(name)])
        found.metadata_props.extend(model.metadata_props)
        model = found
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
