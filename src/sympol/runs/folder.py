"""A run is a folder, and everything done later needs that folder and nothing else.

| file | what |
|---|---|
| `config.toml` | environment, seed, preset, every hyperparameter, versions |
| `metrics.csv` | a row a validation |
| `checkpoints/` | the newest two states of the training |
| `start.json` | the tree that the training started from, if it did; `[run.start]` of the config says where it is from |
| `policy.json` | the tree (docs/tree-json.md) |
| `policy.py`, `tree.txt`, `tree.svg` | the tree as a program, as text, as a picture |
| `summary.json` | what it earns, how big it is, how long it took |

A soft tree has only `tree.txt` and `tree.svg`. A tree that was distilled has no checkpoints and no metrics, and its
config says of what it was made, and how: `[run.distilled]`.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from .. import __version__
from ..algos.config import Config
from ..algos.start import Start
from ..algos.state import TrainState
from ..envs import native
from ..envs.registry import UnknownEnvironment, resolve
from ..envs.spec import EnvSpec
from ..trees import DecisionTree
from .about import CONFIG, RunError, describe, is_run, read, to_toml
from .checkpoint import CheckpointError, has_checkpoints, load_latest, save, write_atomically
from .metrics import MetricsFile

_START = "start.json"
_MADE = (
    "checkpoints",
    "distilled",
    "tensorboard",
    "metrics.csv",
    _START,
    "policy.json",
    "policy.py",
    "tree.txt",
    "tree.svg",
    "summary.json",
    "episode.gif",
    "report.html",
)


class Run:
    """One run's folder; see the module for what is in it."""

    def __init__(self, path: Path, about: Mapping[str, Any], config: Config) -> None:
        self.path, self.about, self.config = path, about, config
        self.metrics = MetricsFile(path / "metrics.csv")

    @classmethod
    def create(
        cls,
        path: Path,
        spec: EnvSpec,
        config: Config,
        seed: int,
        *,
        preset: str = "default",
        eval_episodes: int = 20,
        overwrite: bool = False,
        distilled: Mapping[str, Any] | None = None,
        start: Start | None = None,
    ) -> Run:
        """Make the folder and write its config; of a tree that was ``distilled``, by what.

        Of a training that starts from a tree, the tree is written, too.

        Raises:
            RunError: it exists and is not to be overwritten, or is not a run, or cannot be written.
        """
        require_free(path, overwrite=overwrite, distilled=bool(distilled))
        begun_with = {} if start is None else start.about()
        about = describe(spec, seed, preset, eval_episodes, distilled or {}, begun_with)
        text = to_toml(about, {} if distilled else config.to_dict())
        try:
            path.mkdir(parents=True, exist_ok=True)
            for name in _MADE:  # what others put beside them stays
                made = path / name
                if made.is_dir() and not made.is_symlink():
                    shutil.rmtree(made)
                else:
                    made.unlink(missing_ok=True)
            if start is not None:
                write_atomically(path / _START, start.tree.to_json().encode())
            write_atomically(path / CONFIG, text.encode())
        except OSError as error:
            raise RunError(
                f"cannot write {path}: {error.strerror}; choose another {_flag(bool(distilled))}"
            ) from error
        return cls(path, about, config)

    @classmethod
    def open(cls, path: Path) -> Run:
        """Read a run's config.

        Raises:
            RunError: there is no run, or it has another format.
        """
        return cls(path, *read(path))

    @property
    def seed(self) -> int:
        """The training's seed."""
        return int(self.about["seed"])

    @property
    def has_tree(self) -> bool:
        """Whether its policy is a tree."""
        return self.is_distilled or self.config.policy == "tree"

    @property
    def is_distilled(self) -> bool:
        """Whether its tree was made of a teacher, so that there is no training to go on with."""
        return bool(self.about["distilled"])

    def require_training(self) -> None:
        """Raise RunError for a tree that was distilled."""
        if self.is_distilled:
            how = self.about["distilled"]
            raise RunError(
                f"{self.path} holds a tree distilled from {how.get('teacher')} by {how.get('method')}: there is no "
                f"training to load or resume; read it with sympol show {self.path}, or in Python "
                "sympol.DecisionTree.from_json of its policy.json"
            )

    def load_start(self) -> Start | None:
        """The tree that the training started from, and how; None where it started with a random policy.

        Raises:
            RunError: it is missing or damaged.
        """
        if not self.about["start"]:
            return None
        file = self.path / _START
        try:
            tree = DecisionTree.from_json(file.read_text(encoding="utf-8"))
            return Start.from_about(tree, self.about["start"])
        except (OSError, TypeError, ValueError, KeyError) as error:
            raise RunError(
                f"{self.path} started from a tree, which cannot be read in {file}: {error}"
            ) from error

    def resolve_env(self, env: Any = None) -> EnvSpec:
        """The environment the run was made on, or ``env`` in its place, under the names of the run.

        Where Numba is not installed a run that trained with its machine code can be read, and only refuses to train on.

        Raises:
            RunError: the environment has no id that is known here.
        """
        backend = self.about["backend"] if env is None else "auto"
        without_numba = backend == "native" and not native.is_installed()
        try:
            spec = resolve(
                self.about["env"] if env is None else env,
                feature_names=self.about["feature_names"],
                action_names=self.about["action_names"],
                env_kwargs=self.about["env_kwargs"] if env is None else None,
                groups=self.about["groups"],
                backend="host" if without_numba else backend,
            )
        except UnknownEnvironment as error:
            raise RunError(
                f"{self.path} was trained on {self.about['env']!r}, which is not known here; register it with "
                "sympol.register, or give the environment itself: sympol.load(path, env=...)"
            ) from error
        spec = replace(spec, is_native=True) if without_numba else spec
        return spec.trained_with(self.config.num_envs)

    def save_checkpoint(self, state: TrainState) -> None:
        """Write the state of the training."""
        save(self.path / "checkpoints", state, int(state.timestep))

    def load_checkpoint(self, template: TrainState) -> TrainState | None:
        """The newest whole state; None where none was saved yet.

        Raises:
            RunError: made by another version of sympol, or all checkpoints are damaged.
        """
        if self.about["sympol"] != __version__:
            raise RunError(
                f"{self.path} was made by sympol {self.about['sympol']}, this is {__version__}: its checkpoints "
                "continue only in the version that made them; policy.json can still be read"
            )
        folder = self.path / "checkpoints"
        if not has_checkpoints(folder):
            return None
        try:
            return load_latest(folder, template)[0]
        except CheckpointError as error:
            raise RunError(f"{error}; train anew with --overwrite, or into another --run-dir") from error

    def save_tree(self, tree: DecisionTree) -> None:
        """Write the tree in every form."""
        self._write("policy.json", tree.to_json())
        self._write("policy.py", tree.to_python())
        self._write("tree.txt", tree.to_text() + "\n")
        temporary = self.path / ".tree.tmp.svg"
        tree.plot(temporary)
        os.replace(temporary, self.path / "tree.svg")

    def load_tree(self) -> DecisionTree:
        """The tree.

        Raises:
            RunError: there is none yet, or it is damaged.
        """
        file = self.path / "policy.json"
        if not self.has_tree:
            raise RunError(
                f"{self.path} holds {self.config.policy!r}, which is no tree; make one of it: "
                f"sympol distill {self.path}"
            )
        try:
            return DecisionTree.from_json(file.read_text(encoding="utf-8"))
        except FileNotFoundError as error:
            raise RunError(
                f"{self.path} has no policy.json yet; "
                + ("distill it again" if self.is_distilled else f"finish it: sympol resume {self.path}")
            ) from error
        except (OSError, ValueError) as error:
            raise RunError(f"{file} cannot be read: {error}") from error

    def load_summary(self) -> dict[str, Any] | None:
        """What came of it, if it is finished.

        Raises:
            RunError: it is damaged.
        """
        file = self.path / "summary.json"
        try:
            summary = json.loads(file.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            raise RunError(f"{file} cannot be read: {error}") from error
        if not isinstance(summary, dict):
            raise RunError(f"{file} cannot be read: it holds no object")
        return summary

    def save_summary(self, summary: Mapping[str, Any]) -> None:
        """Write what came of it."""
        self._write("summary.json", json.dumps(summary, indent=2) + "\n")

    def _write(self, name: str, text: str) -> None:
        write_atomically(self.path / name, text.encode())


def require_free(path: Path, *, overwrite: bool, distilled: bool = False) -> None:
    """Raise RunError where no run can be made: a file, something else's folder, or a run not to be replaced."""
    flag = _flag(distilled)
    if path.exists() and not path.is_dir():
        raise RunError(f"{path} is a file; choose another {flag}")
    if path.is_dir() and any(path.iterdir()):
        if not is_run(path / "config.toml"):
            raise RunError(f"{path} exists and is not a sympol run; choose another {flag}")
        if not overwrite:
            go_on = "" if distilled else f"continue it with `sympol resume {path}`, "
            raise RunError(
                f"{path} already holds a run; {go_on}replace it with --overwrite, or choose another {flag}"
            )


def _flag(distilled: bool) -> str:
    return "--out" if distilled else "--run-dir"
