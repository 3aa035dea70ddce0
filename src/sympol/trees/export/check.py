"""The check of exports: write a tree, run what was written here, and compare its actions with the tree's."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import BaseTree
from .formats import FORMATS, format_of
from .toolchain import Run

if TYPE_CHECKING:
    from jaxtyping import Float, Float32


def check(tree: BaseTree, to: str, n: int = 100_000, **options: Any) -> None:
    """Check that an export acts as its tree does, on observations that can tell them apart.

    Args:
        tree: The tree.
        to: The name of a format whose programs can be run.
        n: The number of observations.
        options: Options of the export.

    Raises:
        FileNotFoundError: If a compiler or an interpreter is missing; the message names its package.
        ImportError: If a library is missing.
        RuntimeError: If the program does not compile or run, or acts differently.
        ValueError: If what is exported cannot be run here.
    """
    x = check_observations(tree, n)
    different = (run(tree, to, x, **options).actions != expected_actions(tree, x)).any(axis=1)
    if different.any():
        raise RuntimeError(
            f"{to} differs from the tree on {different.sum():,} of {len(x):,} observations, first on "
            f"{x[different.argmax()].tolist()}; please report this"
        )


def run(
    tree: BaseTree, to: str, x: Float32[np.ndarray, "batch features"], *, rounds: int = 1, **options: Any
) -> Run:
    """Export a tree, compile it, and run it on observations.

    Args:
        tree: The tree.
        to: The name of a format whose programs can be run.
        x: The observations.
        rounds: How often the program goes through them; each round is timed.
        options: Options of the export. A ``name`` is ignored: what is run is called ``policy``.

    Returns:
        The actions [batch, outputs] and the seconds of each round.

    Raises:
        FileNotFoundError: If a compiler or an interpreter is missing; the message names its package.
        ImportError: If a library is missing.
        RuntimeError: If the program does not compile or run.
        ValueError: If what is exported cannot be run here, or the tree has no features.
    """
    if not (form := format_of(to)).runner:
        runnable = ", ".join(name for name, other in FORMATS.items() if other.runner)
        raise ValueError(f"what is exported to {to} cannot be run here; {runnable} can")
    if not tree.n_features:
        raise ValueError("a tree without features cannot be checked: its observations are empty")
    options.pop("name", None)
    done = form.run(tree, np.ascontiguousarray(x, np.float32), rounds, **options)
    return Run(np.asarray(done.actions).reshape(len(x), -1), done.seconds)


def expected_actions(
    tree: BaseTree, x: Float32[np.ndarray, "batch features"]
) -> Float[np.ndarray, "batch outputs"]:
    """Return the actions of a tree in the form of `run`."""
    return tree.predict(x).reshape(len(x), -1)


def check_observations(tree: BaseTree, n: int, seed: int = 0) -> Float32[np.ndarray, "n features"]:
    """Draw observations on thresholds and bounds, beside them and anywhere; infinite, NaN and tiny ones among them.

    Args:
        tree: The tree; it accepts all of them.
        n: The number of observations.
        seed: Seed of the random numbers.
    """
    rng = np.random.default_rng(seed)
    tiny = np.array([0.0, -0.0, 1e-40, -1e-40, 2.0**-126, -(2.0**-126)], np.float32)
    special = np.concatenate([tiny, np.array([np.inf, -np.inf, np.nan, 3e38, -3e38], np.float32)])
    at = np.concatenate([tree.threshold[~tree.is_leaf], tree.feature_low, tree.feature_high])
    up, down = (np.nextafter(at, np.float32(end)) for end in (np.inf, -np.inf))
    x = rng.choice(np.concatenate([at, up, down, special]), (n, tree.n_features))
    anywhere = rng.normal(size=x.shape) * rng.choice([0.1, 1, 10], x.shape)
    x = np.where(rng.random(x.shape) < 0.3, anywhere, x).astype(np.float32)
    for feature in range(tree.n_features):  # most errors show at the thresholds of a number's own feature
        own = tree.threshold[tree.feature == feature]
        if own.size:
            exact = rng.choice(own, n)
            beside = np.nextafter(exact, rng.choice(np.array([-np.inf, np.inf], np.float32), n))
            drawn = rng.random(n)
            x[:, feature] = np.where(drawn < 0.2, exact, np.where(drawn < 0.4, beside, x[:, feature]))
    for group in tree.groups:
        x[:, group.features] = np.eye(len(group.features))[rng.integers(len(group.features), size=n)]
    return x
