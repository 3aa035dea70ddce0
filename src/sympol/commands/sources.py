"""Where commands take trees from: a run's folder, or a file."""

from __future__ import annotations

from pathlib import Path

from ..envs.registry import UnknownEnvironment, resolve
from ..envs.spec import EnvSpec
from ..runs.about import CONFIG, RunError
from ..runs.folder import Run
from ..trees import DecisionTree


def tree_from(path: Path) -> DecisionTree:
    """The tree of a run's folder or of a .json file; no environment is made.

    Raises:
        RunError: nothing is there, or what is there holds no tree; the message says what to do.
    """
    if path.is_dir() or not path.suffix:
        return Run.open(path).load_tree()
    try:
        return DecisionTree.from_json(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise RunError(f"there is no {path}; give a run's folder, or a policy.json") from error
    except OSError as error:
        raise RunError(f"{path} cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        raise RunError(f"{path} cannot be read: {error}") from error


def spec_from(path: Path, tree: DecisionTree) -> EnvSpec:
    """The environment of `tree_from`'s tree: that of the run it is in, or the one that its ``meta`` names.

    Raises:
        RunError: it is in no run and names none, or one that is not known here, or one with other features.
    """
    folder = path if path.is_dir() else path.parent
    name, kwargs = tree.meta.get("env"), tree.meta.get("env_kwargs")
    if (folder / CONFIG).exists():
        spec = Run.open(folder).resolve_env()
    elif not isinstance(name, str):
        raise RunError(
            f'nothing says where the tree of {path} acts: it is in no run\'s folder, and its "meta" has no "env"'
        )
    else:
        try:
            spec = resolve(name, env_kwargs=kwargs if isinstance(kwargs, dict) else None)
        except UnknownEnvironment as error:
            raise RunError(f"{path} acts on {name!r}, which is not known here: {error}") from error
    if len(spec.features.names) != tree.n_features:
        raise RunError(
            f"the tree of {path} looks at {tree.n_features} features, but {spec.name} has "
            f"{len(spec.features.names)}"
        )
    return spec
