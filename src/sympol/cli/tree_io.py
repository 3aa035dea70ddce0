"""The trees and environments that commands are given, by a run's folder or a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from .. import files
from ..envs.origin import Origin
from ..runs.metadata import CONFIG, RunError
from ..runs.run import Run
from ..runs.trust import trusted_id
from ..trees import DecisionTree
from ..trees.text_parser import FENCE, parse_document
from .arguments import PlaysRun

if TYPE_CHECKING:
    from ..envs.spec import EnvSpec


def tree_from(path: Path) -> DecisionTree:
    """Return the tree of a run's folder, or of a .json or .txt file.

    The header of a .txt names its features and actions, or the environment that has them; without a header, they are
    those of the policy.json beside it.

    Args:
        path: The folder or the file.

    Raises:
        RunError: Nothing is there, or it holds no tree; the message names the remedy.
    """
    if path.is_dir() or not path.suffix:
        return Run.open(path).load_tree()
    try:
        text = files.read_text(path)
        return _from_text(path, text) if path.suffix == ".txt" else DecisionTree.from_json(text)
    except FileNotFoundError as error:
        raise RunError(
            f"there is no {path}; give a run's folder, a policy.json, or a listing in a .txt"
        ) from error
    except OSError as error:
        raise RunError(f"{path} cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        raise RunError(f"{path} cannot be read: {error}") from error


def _from_text(path: Path, text: str) -> DecisionTree:
    header = parse_document(text).header
    if "features" in header:
        return DecisionTree.from_text(text)
    if "env" in header:
        spec = _environment(path, header["env"], header.get("meta", {}))
        return DecisionTree.from_text(text, actions=spec.actions, **spec.features.metadata())
    beside = path.with_name("policy.json")
    if not beside.exists():
        raise RunError(
            f"nothing says which features and actions {path} is about: begin it with a header, such as the three "
            f'lines {FENCE} / env = "CartPole-v1" / {FENCE}, or put it beside a policy.json'
        )
    return DecisionTree.from_text(text, like=tree_from(beside))


def spec_from(path: Path, tree: DecisionTree, given: PlaysRun | None = None) -> EnvSpec:
    """Return the environment of `tree_from`'s tree: ``--env``, that of the run it is in, or the one its ``meta`` names.

    Args:
        path: The run's folder or the tree's file.
        tree: The tree.
        given: The flags ``--env`` and ``--trust``.

    Raises:
        RunError: The tree is in no run and names no environment, or one that is not known here or has other features.
    """
    folder, given = path if path.is_dir() else path.parent, given or PlaysRun()
    if (folder / CONFIG).exists():
        spec = Run.open(folder, given.env, trust=given.trust).resolve_env()
    elif given.env is not None:
        from ..envs.registry import resolve

        spec = resolve(given.env)
    elif "env" in tree.meta:
        spec = _environment(path, tree.meta["env"], tree.meta, trust=given.trust)
    else:
        raise RunError(
            f'nothing says where the tree of {path} acts: it is in no run\'s folder, and its "meta" has no "env"'
        )
    if len(spec.features.names) != tree.n_features:
        raise RunError(
            f"the tree of {path} looks at {tree.n_features} features, but {spec.name} has "
            f"{len(spec.features.names)}"
        )
    return spec


def _environment(path: Path, name: object, meta: object, *, trust: bool = False) -> EnvSpec:
    """Return the environment that a file names; no module is imported for it, as the file may be a stranger's."""
    if not isinstance(name, str):
        raise RunError(f"{path} names the environment {name!r}, which must be text, such as 'CartPole-v1'")
    file = meta.get("file", "") if isinstance(meta, dict) else ""
    exact = trusted_id(name, path, trust=trust, file=file if isinstance(file, str) else "")

    from ..envs.errors import UnknownEnvironment
    from ..envs.registry import resolve

    try:
        origin = Origin.from_dict(meta if isinstance(meta, dict) else {})
        if origin.not_kept:
            raise RunError(
                f"{path} is of {name}, {origin.not_kept}; give the environment: --env module:Id or --env file.py:Name"
            )
        return resolve(exact, env_kwargs=origin.env_kwargs, wrappers=origin.wrappers)
    except UnknownEnvironment as error:
        raise RunError(f"{path} acts on {name!r}, which is not known here: {error}") from error
