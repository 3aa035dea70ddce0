"""`sympol.functional.hard_tree` for PyTorch: the same tree, and the same straight-through gradient.

Forward it is an ordinary tree. Backward each comparison stands in for S(threshold − x), each choice of a feature for
entmax15. An observation contributes at the D nodes of its own path, where the leaves that it would have reached from
the children not taken are all that has to be found besides: O(B·D² + N·F), no product over leaves.

    D depth   N = 2^D − 1 inner nodes   L = 2^D leaves   F features   A action values   B batch

Node n has the children 2n + 1 (left) and 2n + 2 (right); leaf l is node N + l.
"""

from __future__ import annotations

from typing import Any, Literal, TypeAlias, get_args

import torch  # pyright: ignore[reportMissingImports]
from jaxtyping import Float, Int
from torch import Tensor  # pyright: ignore[reportMissingImports]

Surrogate: TypeAlias = Literal["sigmoid", "softsign"]

MAX_DEPTH = 14
NEWTON_STEPS = 6
"""After these float32 stands still, as in `sympol.functional.entmax`."""
_SMALLEST_NORMAL = torch.finfo(torch.float32).tiny


def hard_tree(
    feature_logits: Float[Tensor, "N F"],
    thresholds: Float[Tensor, "N F"],
    leaf_values: Float[Tensor, "L A"],
    x: Float[Tensor, "B F"],
    *,
    surrogate: Surrogate = "sigmoid",
) -> Float[Tensor, "B A"]:
    """Evaluate a hard decision tree, differentiable in its three parameters.

    Node n looks at feature j = argmax feature_logits[n] (the lowest index wins a tie) and sends an observation left
    where x[j] ≤ thresholds[n, j], right otherwise, NaN included. Subnormal numbers count as zero.

    The gradient is the exact straight-through gradient of `sympol.functional.hard_tree`; entries of ``x`` that are NaN
    or infinite contribute nothing to it, and ``x`` itself has none.

    Args:
        feature_logits: ``[N, F]``; the largest logit of a node chooses its feature.
        thresholds: ``[N, F]``; a threshold for each feature that a node may compare.
        leaf_values: ``[L, A]`` with L = N + 1; the outputs of each leaf.
        x: Observations ``[B, F]``.
        surrogate: The function whose slope replaces that of the hard step, ``"sigmoid"`` or ``"softsign"``.

    Returns:
        Outputs ``[B, A]``.

    Raises:
        ValueError: if shapes, dtypes or the surrogate do not fit.
    """
    _check(feature_logits, thresholds, leaf_values, x, surrogate)
    return _HardTree.apply(feature_logits, thresholds, leaf_values, x, surrogate)


def select(
    feature_logits: Float[Tensor, "N F"], thresholds: Float[Tensor, "N F"]
) -> tuple[Int[Tensor, " N"], Float[Tensor, " N"]]:
    """The feature each node looks at, and its threshold."""
    feature = feature_logits.argmax(dim=1)  # of several largest ones PyTorch takes the first, too
    return feature, flush(thresholds.gather(1, feature[:, None])[:, 0])


def flush(values: Tensor) -> Tensor:
    """Subnormal numbers to zero."""
    return torch.where(values.abs() < _SMALLEST_NORMAL, 0.0, values)


class _HardTree(torch.autograd.Function):
    """The tree and its gradient, as one operation of autograd's."""

    @staticmethod
    def forward(
        ctx: Any,
        feature_logits: Tensor,
        thresholds: Tensor,
        leaf_values: Tensor,
        x: Tensor,
        surrogate: Surrogate,
    ) -> Tensor:
        feature, threshold = select(feature_logits, thresholds)
        node = torch.zeros(len(x), dtype=torch.int64, device=x.device)
        path, differences = [], []
        for _ in range(_depth(leaf_values)):
            path.append(node)
            node, difference = _descend(feature, threshold, x, node)
            differences.append(difference)
        leaf = node - len(feature)
        ctx.surrogate = surrogate
        ctx.save_for_backward(
            feature_logits, thresholds, leaf_values, x, feature, threshold, leaf, torch.stack(path),
            torch.stack(differences),
        )  # fmt: skip
        return flush(leaf_values)[leaf]

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        (g,) = gradients
        feature_logits, thresholds, leaf_values, x, feature, threshold, leaf, path, difference = (
            ctx.saved_tensors
        )
        num_nodes, num_features = feature_logits.shape
        child = torch.cat([path[1:], leaf[None] + num_nodes])
        went_left = child % 2 == 1
        sibling = torch.where(went_left, child + 1, child - 1)
        # all siblings descend to a leaf together, the one of the next level joining after each step
        walk = sibling[:1]
        for level in range(1, len(path)):
            walk = torch.cat([_descend(feature, threshold, x, walk)[0], sibling[level : level + 1]])

        own = (g * leaf_values[leaf]).sum(dim=1)
        other = (g * leaf_values[walk - num_nodes]).sum(dim=2)
        delta = torch.where(went_left, own - other, other - own)
        c = delta * _slope(ctx.surrogate, difference)

        # at each node the sums over the batch of c·x and, in a last column, of c
        seen = torch.nn.functional.pad(torch.where(x.isfinite(), x, 0.0), (0, 1), value=1.0)
        sums = seen.new_zeros(num_nodes, num_features + 1)
        sums.index_add_(0, path.flatten(), (c[:, :, None] * seen).flatten(0, 1))
        product, total = sums[:, :-1], sums[:, -1:]
        of_choice = total * torch.where(thresholds.isfinite(), thresholds, 0.0) - product
        return (
            entmax15_vjp(feature_logits, of_choice),
            torch.zeros_like(thresholds).scatter(1, feature[:, None], total),
            torch.zeros_like(leaf_values).index_add(0, leaf, g),
            None,
            None,
        )


def entmax15_vjp(logits: Float[Tensor, "rows n"], v: Float[Tensor, "rows n"]) -> Float[Tensor, "rows n"]:
    """The derivative of entmax15 along the last axis times ``v``.

    With s = √entmax15(logits) it is (diag(s) − s sᵀ / Σs) v. Newton's method from the left finds the t for which
    ‖(logits/2 − t)₊‖ = 1, and s is what is within the norm there: see `sympol.functional.entmax`.
    """
    z = (logits - logits.amax(dim=1, keepdim=True)) / 2
    t = torch.full_like(z[:, :1], -1.0)
    for _ in range(NEWTON_STEPS):
        s = (z - t).clamp(min=0)
        square = (s * s).sum(dim=1, keepdim=True)
        t = t + (square - square.sqrt()) / s.sum(dim=1, keepdim=True)
    s = (z - t).clamp(min=0)
    return s * (v - (s * v).sum(dim=1, keepdim=True) / s.sum(dim=1, keepdim=True))


def _slope(surrogate: Surrogate, difference: Tensor) -> Tensor:
    """S′, the derivative of the surrogate; nothing where the difference is not a number."""
    if surrogate == "sigmoid":
        e = (-difference.abs()).exp()
        slope = e / (1 + e).square()
    else:
        slope = 0.5 / (1 + difference.abs()).square()
    return torch.where(slope.isnan(), 0.0, slope)


def _descend(feature: Tensor, threshold: Tensor, x: Tensor, node: Tensor) -> tuple[Tensor, Tensor]:
    """Where the observations at these nodes [..., B] go next, and threshold − x there."""
    row = torch.arange(len(x), device=x.device)
    value = flush(x[row, feature[node]])
    limit = threshold[node]
    return 2 * node + torch.where(value <= limit, 1, 2), limit - value


def _depth(leaf_values: Tensor) -> int:
    return len(leaf_values).bit_length() - 1


def _check(
    feature_logits: Tensor, thresholds: Tensor, leaf_values: Tensor, x: Tensor, surrogate: str
) -> None:
    """Raise a ValueError that names the value, the rule and the remedy."""
    named = {"feature_logits": feature_logits, "thresholds": thresholds, "leaf_values": leaf_values, "x": x}
    for name, array in named.items():
        if array.ndim != 2 or array.dtype != torch.float32:
            raise ValueError(
                f"{name} must be float32 of 2 axes, got {array.dtype} of shape {tuple(array.shape)}; convert it with "
                ".float(), and give observations as a batch"
            )
    depth, num_leaves = _depth(leaf_values), len(leaf_values)
    if num_leaves != 2**depth or not 1 <= depth <= MAX_DEPTH:
        raise ValueError(
            f"leaf_values must have 2^depth rows, depth from 1 to {MAX_DEPTH}, got {num_leaves}; pad the tree to a "
            "full one"
        )
    expected = (num_leaves - 1, x.shape[1])
    for name, array in (("feature_logits", feature_logits), ("thresholds", thresholds)):
        if tuple(array.shape) != expected or not x.shape[1]:
            raise ValueError(
                f"{name} must have shape {expected} (2^depth − 1 inner nodes for {num_leaves} leaves, the "
                f"{x.shape[1]} features of x, at least one), got {tuple(array.shape)}"
            )
    if surrogate not in get_args(Surrogate):
        raise ValueError(f"surrogate must be one of {', '.join(get_args(Surrogate))}, got {surrogate!r}")
