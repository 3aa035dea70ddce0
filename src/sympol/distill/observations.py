"""Back from flat features to the observations that an environment returns, for teachers that know only those."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import Space
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Tuple
from jaxtyping import Float32


def unflatten(space: Space, x: Float32[np.ndarray, "*batch features"]) -> Any:
    """Undo `Features.flatten`.

    Every array has its space's own dtype; digits that float32 rounded off stay lost.

    Args:
        space: The observation space.
        x: Features ``[features]``, or a batch ``[batch, features]``.

    Returns:
        An observation, or a batch of them, which has its leading axis on every array inside, as in Gymnasium's vector
        environments.
    """
    return _parts(space, x, 0)[0]


def _parts(space: Space, x: np.ndarray, at: int) -> tuple[Any, int]:
    """The observation whose features begin at ``at``, and where they end."""
    match space:
        case Box() | MultiBinary():
            shape = space.shape or ()
            end = at + int(np.prod(shape, dtype=int))
            return x[..., at:end].reshape((*x.shape[:-1], *shape)).astype(space.dtype), end
        case Discrete():
            end = at + int(space.n)
            return _category(x[..., at:end], int(space.start), space.dtype), end
        case MultiDiscrete():
            ends = at + np.cumsum(space.nvec.ravel())
            starts = ends - space.nvec.ravel()
            chosen = [
                _category(x[..., i:j], start, space.dtype)
                for i, j, start in zip(starts, ends, space.start.ravel().tolist(), strict=True)
            ]
            return np.stack(chosen, axis=-1).reshape((*x.shape[:-1], *space.nvec.shape)), int(ends[-1])
        case Dict() | Tuple():
            items = space.spaces.items() if isinstance(space, Dict) else enumerate(space.spaces)
            parts = {}
            for key, part in items:
                parts[key], at = _parts(part, x, at)
            return (parts if isinstance(space, Dict) else tuple(parts.values())), at
    raise ValueError(f"unsupported observation space {space}")


def _category(one_hot: np.ndarray, start: int, dtype: Any) -> Any:
    return (np.argmax(one_hot, axis=-1) + start).astype(dtype)
