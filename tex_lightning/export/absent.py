"""ONNX files that compute only the senses with a recording."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np


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
