"""ONNX graphs whose parts are left out where their inputs hold nothing."""

import numpy as np
import pytest

from tex_lightning.export.onnx_file import skip_absent

onnx = pytest.importorskip("onnx")
GRAPH = """
<ir_version: 10, opset_import: ["" : 20]>
g (float[1, n] a, float[h, w] b)
  => (float[1, n] a_double, float mean, float[h, w] b_root, float total)
  <int64[1] one = {1}, float two = {2.0}> {
  a_double = Mul (a, two)
  mean = ReduceMean <keepdims = 0> (a)
  raised = Add (b, two)
  b_root = Sqrt (raised)
  sum_a = ReduceSum <keepdims = 0> (a_double)
  sum_b = ReduceSum <keepdims = 0> (b_root)
  sums = Add (sum_a, sum_b)
  total = Add (sums, mean)
}
"""


def test_a_part_without_input_is_not_computed_and_adds_nothing():
    runtime = pytest.importorskip("onnxruntime")
    model = onnx.shape_inference.infer_shapes(onnx.parser.parse_model(GRAPH))
    found = skip_absent(
        model, {"a": ["a_double", "mean"], "b": ["b_root"]}, ["a_double", "b_root", "total"]
    )
    onnx.checker.check_model(found, full_check=True)
    assert not {"Mul", "ReduceMean", "Sqrt"} & {node.op_type for node in found.graph.node}
    session = runtime.InferenceSession(found.SerializeToString())
    a, b = np.float32([[1, 2, 4]]), np.float32([[2, 7]])
    none = {"a": np.zeros((1, 0), np.float32), "b": np.zeros((0, 0), np.float32)}
    whole = runtime.InferenceSession(model.SerializeToString()).run(["total"], {"a": a, "b": b})
    double, root, total = session.run(None, {"a": a, "b": b})
    assert total == whole[0]
    np.testing.assert_array_equal(double, 2 * a)
    np.testing.assert_array_equal(root, np.sqrt(b + 2))
    double, root, total = session.run(None, {"a": none["a"], "b": b})
    assert (double.shape, total) == ((1, 0), np.sqrt(b + 2).sum())
    double, root, total = session.run(None, {"a": a, "b": none["b"]})
    assert root.shape == (0, 0)
    assert total == pytest.approx(2 * a.sum() + a.mean())
