"""A run is a folder, and everything done later needs that folder and nothing else.

| file | content |
|---|---|
| `config.toml` | environment, seed, preset, every hyperparameter, versions |
| `metrics.csv` | one row for each validation |
| `checkpoints/` | the two newest states of the training |
| `start.json` | the tree that the training started from, if any; `[run.start]` of the config says where it is from |
| `policy.json` | the tree (docs/guides/tree-json.md) |
| `policy.py`, `tree.txt`, `tree.svg` | the tree as a program, as text, as a picture |
| `summary.json` | its returns, its size, its times |

A soft tree has only `tree.txt` and `tree.svg`. A distilled tree has no checkpoints and no metrics; `[run.distilled]` of
its config says what it was made of, and how.

Reading a run imports neither JAX nor Gymnasium: what needs them is imported where checkpoints are read or written, and
where the environment is made.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import shlex
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from .. import files
from ..algorithms.config import Config
from ..bounded import parse_json
from ..envs.libraries import is_library_id
from ..envs.origin import Origin
from ..trees import DecisionTree
from ..version import __version__
from .checkpoint import CheckpointError, has_checkpoints, load_latest, save
from .clearing import FORMS, START, clear, folder_flag, require_free, written_by
from .lock import FolderLock, Held
from .metadata import CONFIG, RunError, WriteError, describe, read, short, to_toml
from .metrics import MetricsFile
from .trust import needs_trust, trusted_id

if TYPE_CHECKING:
    from ..algorithms.state import TrainState
    from ..algorithms.warm_start import Start
    from ..envs.spec import EnvSpec

_NUMBERS = {
    *("return_mean", "return_std", "sampled_return_mean", "sampled_return_std", "teacher_return_mean"),
    *("teacher_return_std", "agreement", "action_difference", "validation_return", "episodes", "timesteps"),
    *("nodes", "nodes_unpruned", "leaves", "depth", "max_nodes", "node_price", "wall_seconds"),
    *("compile_seconds", "training_seconds", "distill_seconds", "steps_per_second"),
}
"""Fields of a summary that are numbers, where it has them."""
_REPAIRS = {
    errno.ENOSPC: "make room there",
    errno.EDQUOT: "make room there",
    errno.EROFS: "make it writable",
    errno.EACCES: "make it writable",
    errno.EPERM: "make it writable",
}
_OBSOLETE = (".losses.", ".metrics[")
"""How the names of arrays begin that earlier checkpoints hold and that are not read: the metrics of the last update."""


class Run:
    """A run's folder.

    Only one process at a time may write in it: the one that made it with `create` or locked it with `take`. The lock
    is released by `close`, at the end of a ``with`` block, with the last reference to the run, and with the process.

    Attributes:
        path: The folder.
        metadata: The table ``[run]`` of its config (`sympol.runs.metadata`).
        config: Its hyperparameters.
        metrics: Its ``metrics.csv``.
        way_on: How to resume or repeat it, as a part of messages.

    Args:
        path: The folder.
        metadata: The table ``[run]`` of its config.
        config: Its hyperparameters.
        env: The environment to use in place of the one that the folder names.
        trust: Whether a module that the folder names may be imported.
    """

    def __init__(
        self, path: Path, metadata: Mapping[str, Any], config: Config, env: Any = None, *, trust: bool = False
    ) -> None:
        self.path, self.metadata, self.config = path, metadata, config
        self._env, self._trust = env, trust
        self.metrics = MetricsFile(path / "metrics.csv")
        self.way_on = (
            "make it again" if self.is_distilled else f"resume with: sympol resume {self.as_argument}"
        )
        self._lock: FolderLock | None = None

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
        flag: str | None = None,
    ) -> Run:
        """Make a run's folder, write its config, and lock it for this process.

        Args:
            path: The folder.
            spec: The environment.
            config: The hyperparameters.
            seed: The training's seed.
            preset: The preset that the hyperparameters are from.
            eval_episodes: Number of test episodes at the end.
            overwrite: Whether a run that is there may be replaced.
            distilled: For a distilled tree, the method, its options and the teacher.
            start: For a training that starts from a tree, the tree and how to start; the tree is written, too.
            flag: The flag that chooses the folder, for messages.

        Returns:
            The run.

        Raises:
            RunError: `require_free` refuses the path, another process writes in it, or it cannot be written.
        """
        flag = flag or folder_flag(distilled=bool(distilled))

        def check() -> None:
            require_free(path, overwrite=overwrite, distilled=bool(distilled), flag=flag)

        check()
        origin = {} if start is None else start.about()
        metadata = describe(spec, seed, preset, eval_episodes, distilled or {}, origin)
        text = to_toml(metadata, {} if distilled else config.to_dict())
        run = cls(path, metadata, config)
        try:
            path.mkdir(parents=True, exist_ok=True)
            run.take(flag)
            check()  # again: another process may have made a run meanwhile
            clear(path)
            if start is not None:
                files.write(path / START, start.tree.to_json())
            files.write(path / CONFIG, text)
        except OSError as error:
            run.close()
            raise RunError(f"cannot write {_reason(error, path)}; choose another {flag}") from error
        except BaseException:
            run.close()
            raise
        return run

    def take(self, flag: str | None = None) -> None:
        """Lock the folder for this process, and remove the unfinished files of processes that were killed.

        Args:
            flag: The flag that chooses another folder, for messages.

        Raises:
            RunError: Another process writes in it.
            OSError: It cannot be written.
        """
        if self._lock is not None:
            return
        try:
            self._lock = FolderLock(self.path)
        except Held as error:
            raise written_by(str(error), self.path, flag) from None
        for folder in (self.path, self.path / "checkpoints"):
            if folder == self.path or not folder.is_symlink():
                files.remove_temporaries(folder)

    def close(self) -> None:
        """Release the lock; its file stays where no config was written, which marks the folder as unused."""
        if self._lock is not None:
            self._lock.release(remove=(self.path / CONFIG).exists())
            self._lock = None

    def __enter__(self) -> Self:
        """Return the run, which is closed at the end of the block."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the run."""
        self.close()

    @classmethod
    def open(cls, path: Path, env: Any = None, *, trust: bool = False) -> Run:
        """Read a run's config.

        Args:
            path: The folder.
            env: The environment to use in place of the one that the folder names, as in `resolve`.
            trust: Whether a module or file that the folder names may be imported, which runs its code.

        Returns:
            The run, whose environment is not made yet.

        Raises:
            RunError: There is no run, or it has another format.
        """
        return cls(path, *read(path), env, trust=trust)

    @property
    def seed(self) -> int:
        """Return the training's seed."""
        return int(self.metadata["seed"])

    @property
    def as_argument(self) -> str:
        """Return the folder as an argument of commands, with --trust if its environment needs code of the user's."""
        return shlex.quote(str(self.path)) + (" --trust" if needs_trust(self.metadata["env"]) else "")

    @property
    def has_tree(self) -> bool:
        """Return whether its policy is a decision tree."""
        return self.is_distilled or self.config.policy == "tree"

    @property
    def is_distilled(self) -> bool:
        """Return whether its tree was distilled from a teacher, so that there is no training to resume."""
        return bool(self.metadata["distilled"])

    def require_training(self) -> None:
        """Refuse a distilled tree.

        Raises:
            RunError: The tree was distilled, so that there is no training.
        """
        if self.is_distilled:
            how = self.metadata["distilled"]
            raise RunError(
                f"{self.path} holds a tree distilled from {how.get('teacher')} by {how.get('method')}: there is no "
                f"training to load or resume; read it with sympol show {self.path}, or in Python "
                "sympol.DecisionTree.from_json of its policy.json"
            )

    def load_start(self) -> Start | None:
        """Return the tree that the training started from, and how, or None for a random policy.

        Returns:
            The start, for `sympol.load`.

        Raises:
            RunError: The tree is missing or damaged.
        """
        if not self.metadata["start"]:
            return None
        from ..algorithms.warm_start import Start

        file = self.path / START
        try:
            tree = DecisionTree.from_json(files.read_text(file, files.MOST))
            return Start.from_about(tree, self.metadata["start"])
        except (OSError, TypeError, ValueError, KeyError, OverflowError) as error:
            raise RunError(
                f"{self.path} started from a tree, which cannot be read in {file}: {error}"
            ) from error

    def resolve_env(self) -> EnvSpec:
        """Return the environment of the run, or the one it was opened with, under the run's names.

        The run's own id stands for its environment, with the arguments and wrappers that the folder keeps. Where the
        folder has the spaces of an environment of Gymnasium, and the user names no other, it is not made before it is
        played. A run that trained with Numba's machine code can be read without Numba, but not resumed.

        Returns:
            The description of the environment.

        Raises:
            RunError: The folder does not describe all of the environment, no such id is known here, or it needs a
                module that must not be imported.
        """
        from ..envs.errors import UnknownEnvironment
        from ..envs.recorded import Recorded
        from ..envs.registry import resolve
        from ..envs.spec import EnvSpec

        names = {name: self.metadata[name] for name in ("feature_names", "action_names", "groups")}
        if isinstance(self._env, EnvSpec):
            return self._env
        is_named = isinstance(self._env, str) and _id(self._env) == _id(self.metadata["env"])
        if self._env is not None and not is_named:
            return resolve(self._env, **names)
        backend = self.metadata["backend"]
        remedy = (
            "give the environment itself: sympol.load(path, env=...), or on the command line --env module:Id or "
            "--env file.py:Name"
        )
        name: str = self._env if isinstance(self._env, str) else self.metadata["env"]
        origin = Origin.from_dict(self.metadata)
        spaces = {} if is_named else self.metadata["spaces"]
        if origin.not_kept:
            raise RunError(f"{self.path} was trained on {name}, {origin.not_kept}; {remedy}")
        if not is_named:
            name = trusted_id(name, self.path, trust=self._trust, file=origin.file)
        try:
            spec = resolve(
                name,
                env_kwargs=origin.env_kwargs,
                wrappers=origin.wrappers,
                backend=backend,
                require_installed=False,
                recorded=Recorded.from_dict(spaces) if spaces else None,
                **names,
            )
        except UnknownEnvironment as error:
            why = f"cannot be made here ({error})" if ":" in name else "is not known here"
            raise RunError(
                f"{self.path} was trained on {self.metadata['env']!r}, which {why}; register it with "
                f"sympol.register, or {remedy}"
            ) from error
        except (TypeError, ValueError) as error:
            raise RunError(f"{self.path / CONFIG}: {error}") from error
        return spec.trained_with(self.config.num_envs)

    @contextlib.contextmanager
    def writing(self) -> Iterator[None]:
        """Turn an OSError within the block into a WriteError that names the file and the remedy.

        Yields:
            Nothing.

        Raises:
            WriteError: A file cannot be written.
        """
        try:
            yield
        except OSError as error:
            repair = _REPAIRS.get(error.errno or 0, "see to that")
            raise WriteError(
                f"cannot write {_reason(error, self.path)}; {repair}, then {self.way_on}"
            ) from error

    def require_own_checkpoints(self) -> None:
        """Refuse to write checkpoints through a link, into a folder outside the run.

        Raises:
            RunError: The folder of the checkpoints is a link.
        """
        folder = self.path / "checkpoints"
        if folder.is_symlink():
            raise RunError(
                f"{folder} is a link to {os.path.realpath(folder)}, and a run writes only in its own folder; put a "
                "folder in the place of the link, with a copy of the files in the other"
            )

    def save_checkpoint(self, state: TrainState) -> None:
        """Write a checkpoint.

        Args:
            state: The state of the training.

        Raises:
            RunError: It cannot be written.
        """
        self.require_own_checkpoints()
        with self.writing():
            save(self.path / "checkpoints", state._replace(metrics={}), int(state.timestep))

    def load_checkpoint(self, template: Callable[[int], TrainState]) -> TrainState | None:
        """Return the newest checkpoint that is whole, or None where none was saved yet.

        Args:
            template: From the environment steps of a checkpoint to a state of its form, with arrays or their shapes.

        Returns:
            The state, or None.

        Raises:
            RunError: Another version of sympol made the run, or all checkpoints are damaged.
        """
        if self.metadata["sympol"] != __version__:
            raise RunError(
                f"{self.path} was made by sympol {self.metadata['sympol']}, this is {__version__}: its checkpoints "
                "continue only in the version that made them; policy.json can still be read"
            )
        folder = self.path / "checkpoints"
        if not has_checkpoints(folder):
            return None
        try:
            return load_latest(folder, template, _OBSOLETE)[0]
        except CheckpointError as error:
            raise RunError(f"{error}; train anew with --overwrite, or into another --run-dir") from error

    def save_tree(self, tree: DecisionTree) -> None:
        """Write the tree in every form.

        Args:
            tree: The tree.

        Raises:
            RunError: A file cannot be written.
        """
        self._write("policy.json", tree.to_json())
        self._write("policy.py", tree.to_python())
        self._write("tree.txt", tree.to_text() + "\n")
        with self.writing():
            tree.plot(self.path / "tree.svg")

    def is_finished(self) -> bool:
        """Return whether the run is finished.

        Returns:
            True if every file that is written at the end of a training is there, and whole.
        """
        try:
            if self.load_summary() is None:
                return False
            if self.has_tree:
                self.load_tree()
        except RunError:
            return False
        return not self.has_tree or all((self.path / name).is_file() for name in FORMS)

    def load_tree(self) -> DecisionTree:
        """Read the tree.

        Returns:
            The tree of ``policy.json``.

        Raises:
            RunError: The policy is no tree, there is none yet, or it is damaged.
        """
        file = self.path / "policy.json"
        if not self.has_tree:
            raise RunError(
                f"{self.path} holds {self.config.policy!r}, which is no tree; make one of it: "
                f"sympol distill {self.path}"
            )
        try:
            return DecisionTree.from_json(files.read_text(file, files.MOST))
        except FileNotFoundError as error:
            raise RunError(
                f"{self.path} has no policy.json yet; "
                + (
                    "distill it again"
                    if self.is_distilled
                    else f"finish it: sympol resume {self.as_argument}"
                )
            ) from error
        except (OSError, ValueError) as error:
            raise RunError(f"{file} cannot be read: {error}") from error

    def load_summary(self) -> dict[str, Any] | None:
        """Read the summary of the run.

        Returns:
            The content of ``summary.json``, or None while the run is not finished.

        Raises:
            RunError: It is damaged.
        """
        file = self.path / "summary.json"
        try:
            summary = parse_json(files.read_text(file), "it", strict=False)
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            raise RunError(f"{file} cannot be read: {error}") from error
        if not isinstance(summary, dict):
            raise RunError(f"{file} cannot be read: it holds no object")
        for name in _NUMBERS & summary.keys():
            if type(summary[name]) not in (int, float):
                raise RunError(
                    f"{file} is not a run's summary: {name} must be a number, got {short(summary[name])}"
                )
        return summary

    def save_summary(self, summary: Mapping[str, Any]) -> None:
        """Write ``summary.json``.

        Args:
            summary: Values that JSON has.

        Raises:
            RunError: It cannot be written.
        """
        self._write("summary.json", json.dumps(summary, indent=2) + "\n")

    def _write(self, name: str, text: str) -> None:
        with self.writing():
            files.write(self.path / name, text)


def _id(env: str) -> str:
    """Return an environment's id without the module that registers it."""
    return env if is_library_id(env) else env.rpartition(":")[2]


def _reason(error: OSError, path: Path) -> str:
    return f"{error.filename or path}: {error.strerror or error}"
