"""A tree as a Treelite model, for the tools that take one (its own GTIL, the Forest Inference Library)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..base import BaseTree
from ..floats import unflushed_threshold
from .common import answers
from .toolchain import Run, timed

if TYPE_CHECKING:
    from jaxtyping import Float32

_LARGEST = 2**24
"""Up to it float32 holds every whole number."""


def to_treelite(tree: BaseTree) -> bytes:
    """Write a regressor, read again by ``treelite.Model.deserialize_bytes``, whose prediction is the action itself.

    It predicts float32 [batch, numbers of an action, 1]: the action's number, or those of its components, or the
    clipped action, flat in C order; a zero has no sign. Observations must be float32. It answers also where a group
    of features is not one-hot, which the tree refuses.

    Args:
        tree: The tree to write.

    Returns:
        The model, serialized.

    Raises:
        ImportError: if treelite is not installed.
        ValueError: if an action is not finite, or a whole number beyond 2^24.
    """
    try:
        from treelite.model_builder import Metadata, ModelBuilder, PostProcessorFunc, TreeAnnotation
    except ImportError as error:
        raise ImportError("exporting to Treelite needs treelite: pip install 'sympol[treelite]'") from error

    rows = answers(tree)
    if not rows.is_float and np.abs(rows.rows).max() > _LARGEST:
        raise ValueError(f"Treelite holds actions as float32, exact up to 2^24, got {tree.actions!r}")
    n = rows.n_outputs
    builder = ModelBuilder(
        threshold_type="float32",
        leaf_output_type="float32",
        metadata=Metadata(
            # one at least: Treelite has no data without columns
            num_feature=max(tree.n_features, 1),
            task_type="kRegressor",
            average_tree_output=False,
            num_target=n,
            num_class=[1] * n,
            leaf_vector_shape=(n, 1),
        ),
        # -1: the leaf's vector is for all targets
        tree_annotation=TreeAnnotation(num_tree=1, target_id=[-1 if n > 1 else 0], class_id=[0]),
        postprocessor=PostProcessorFunc(name="identity"),
        base_scores=[0.0] * n,
    )
    builder.start_tree()
    for node in range(tree.n_nodes):
        builder.start_node(node)
        if tree.is_leaf[node]:
            answer = [float(x) for x in rows.of(node)]
            builder.leaf(answer if n > 1 else answer[0])
        else:
            builder.numerical_test(
                feature_id=int(tree.feature[node]),
                threshold=unflushed_threshold(tree.threshold[node]),
                default_left=False,
                opname="<=",
                left_child_key=int(tree.children_left[node]),
                right_child_key=int(tree.children_right[node]),
            )
        builder.end_node()
    builder.end_tree()
    return bytes(builder.commit().serialize_bytes())


def run_treelite(tree: BaseTree, x: Float32[np.ndarray, "batch features"], rounds: int) -> Run:
    """Predict by Treelite's own GTIL on observations: see `sympol.trees.export.check`."""
    written = to_treelite(tree)
    import treelite

    model = treelite.Model.deserialize_bytes(written)
    actions, seconds = timed(rounds, lambda: treelite.gtil.predict(model, x))
    return Run(actions.astype(answers(tree).rows.dtype), seconds)
