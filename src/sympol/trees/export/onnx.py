"""A tree as ONNX: the standard operator for trees finds the leaf, and a table says what is done there."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from ..actions import BoxActions, DiscreteActions
from ..base import BaseTree
from ..floats import unflushed_threshold
from .common import answers, check_name
from .toolchain import Run, timed

if TYPE_CHECKING:
    from jaxtyping import Float32

_IR_VERSION, _OPSET, _ML_OPSET = 9, 17, 3
"""Old ones: onnxruntime refuses models that are newer than itself."""
_MOST_ROWS = 2**24
"""Up to it a float32 counts."""


def to_onnx(tree: BaseTree, *, name: str = "policy") -> bytes:
    """Write a model from ``observation``, float32 [batch, features], to ``action``, which is what `predict` returns.

    Actions are int64 [batch] where they are discrete, int64 [batch, components] for several components, and float32
    [batch, *shape], clipped, where they are continuous, all to the bit. It answers also where a group of features is
    not one-hot, which the tree refuses. The names of features and actions are JSON in the model's metadata.

    Args:
        tree: What is written.
        name: Of the graph.

    Returns:
        The model, serialized.

    Raises:
        ImportError: if onnx is not installed.
        ValueError: if the name is none, or an action is not finite or beyond 2^53.
    """
    try:
        from onnx import TensorProto, helper, numpy_helper
    except ImportError as error:
        raise ImportError("exporting to ONNX needs onnx: pip install 'sympol[onnx]'") from error

    rows = answers(tree)
    if len(rows.rows) > _MOST_ROWS:
        raise ValueError(f"ONNX counts at most {_MOST_ROWS} different actions, got {len(rows.rows)}")
    shape = _shape(tree)
    number = TensorProto.FLOAT if rows.is_float else TensorProto.INT64
    found = helper.make_node(
        "TreeEnsembleRegressor",
        ["observation"],
        ["found"],
        domain="ai.onnx.ml",
        n_targets=1,
        **_nodes(tree, rows.row_of),
    )
    graph = helper.make_graph(
        [
            found,
            # [batch, 1] → [batch]: the leaf's row of the table
            helper.make_node("Reshape", ["found", "flat"], ["row"]),
            helper.make_node("Cast", ["row"], ["index"], to=TensorProto.INT64),
            helper.make_node("Gather", ["answers", "index"], ["action"], axis=0),
        ],
        check_name(name),
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["batch", tree.n_features])],
        [helper.make_tensor_value_info("action", number, ["batch", *shape])],
        [
            numpy_helper.from_array(rows.rows.reshape(-1, *shape), "answers"),
            numpy_helper.from_array(np.array([-1], np.int64), "flat"),
        ],
    )
    imports = [helper.make_opsetid("", _OPSET), helper.make_opsetid("ai.onnx.ml", _ML_OPSET)]
    model = helper.make_model(graph, opset_imports=imports, ir_version=_IR_VERSION, producer_name="sympol")
    # in ASCII: what is no Unicode cannot be in a protocol buffer
    names = {"features": json.dumps(tree.feature_names), "actions": json.dumps(tree.actions.names)}
    helper.set_model_props(model, names)
    return model.SerializeToString()


def _shape(tree: BaseTree) -> tuple[int, ...]:
    if isinstance(tree.actions, DiscreteActions):
        return ()
    return tree.actions.shape if isinstance(tree.actions, BoxActions) else (len(tree.actions.nvec),)


def _nodes(tree: BaseTree, row_of: np.ndarray) -> dict[str, Any]:
    """The attributes of the operator: every leaf's one number is its row."""
    leaf, leaves = tree.is_leaf, np.flatnonzero(tree.is_leaf).tolist()
    every = range(tree.n_nodes)
    return {
        "nodes_treeids": [0 for _ in every],
        "nodes_nodeids": list(every),
        "nodes_modes": ["LEAF" if leaf[node] else "BRANCH_LEQ" for node in every],
        "nodes_featureids": np.where(leaf, 0, tree.feature).tolist(),
        "nodes_values": [0.0 if leaf[node] else unflushed_threshold(tree.threshold[node]) for node in every],
        "nodes_truenodeids": np.where(leaf, 0, tree.children_left).tolist(),
        "nodes_falsenodeids": np.where(leaf, 0, tree.children_right).tolist(),
        "nodes_missing_value_tracks_true": [0 for _ in every],
        "target_treeids": [0 for _ in leaves],
        "target_nodeids": leaves,
        "target_ids": [0 for _ in leaves],
        "target_weights": row_of[leaves].astype(np.float32).tolist(),
    }


def run_onnx(tree: BaseTree, x: Float32[np.ndarray, "batch features"], rounds: int) -> Run:
    """Run the model in onnxruntime on observations: see `sympol.trees.export.check`."""
    try:
        import onnxruntime
    except ImportError as error:
        raise ImportError("checking an ONNX model needs onnxruntime: pip install onnxruntime") from error
    session = onnxruntime.InferenceSession(to_onnx(tree), providers=["CPUExecutionProvider"])
    actions, seconds = timed(rounds, lambda: session.run(None, {"observation": x})[0])
    return Run(np.asarray(actions), seconds)
