"""A run is a folder, and everything done later needs that folder and nothing else.

| file | what |
|---|---|
| `config.toml` | environment, seed, preset, every hyperparameter, versions |
| `metrics.csv` | a row a validation |
| `checkpoints/` | the newest two states of the training |
| `start.json` | the tree that the training started from, if it did; `[run.start]` of the config says where it is from |
| `policy.json` | the tree (docs/guides/tree-json.md) |
| `policy.py`, `tree.txt`, `tree.svg` | the tree as a program, as text, as a picture |
| `summary.json` | what it earns, how big it is, how long it took |

A soft tree has only `tree.txt` and `tree.svg`. A tree that was distilled has no checkpoints and no metrics, and its
config says of what it was made, and how: `[run.distilled]`.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Self

from .. import __version__, files
from ..algorithms.config import Config
from ..algorithms.state import TrainState
from ..algorithms.warm_start import Start
from ..bounded import parse_json
from ..envs.origin import Origin
from ..envs.registry import UnknownEnvironment, resolve
from ..envs.spec import EnvSpec
from ..trees import DecisionTree
from .about import CONFIG, RunError, WriteError, describe, is_run, read, require_no_import, short, to_toml
from .checkpoint import CheckpointError, has_checkpoints, load_latest, remove_all, save
from .lock import LOCK, FolderLock, Held, writer_of
from .metrics import MetricsFile

_START = "start.json"
_FORMS = ("policy.json", "policy.py", "tree.txt", "tree.svg")
"""A tree's."""
_MADE = ("metrics.csv", *_FORMS, "summary.json", "episode.gif", "report.html")
_NUMBERS = {
    *("return_mean", "return_std", "sampled_return_mean", "sampled_return_std", "teacher_return_mean"),
    *("teacher_return_std", "agreement", "action_difference", "validation_return", "episodes", "timesteps"),
    *("nodes", "nodes_unpruned", "leaves", "depth", "max_nodes", "node_price", "wall_seconds"),
    *("compile_seconds", "training_seconds", "distill_seconds", "steps_per_second"),
}
"""Of a summary, where it has them."""
_REPAIRS = {
    errno.ENOSPC: "make room there",
    errno.EDQUOT: "make room there",
    errno.EROFS: "make it writable",
    errno.EACCES: "make it writable",
    errno.EPERM: "make it writable",
}


class Run:
    """One run's folder; see the module for what is in it.

    Only one process at a time may write in it: the one that made it with `create`, or took it with `take`. It gives it
    back with `close`, at the end of a ``with`` block, with the last reference to the run, or when it ends.
    """

    def __init__(
        self, path: Path, about: Mapping[str, Any], config: Config, env: Any = None, *, trust: bool = False
    ) -> None:
        self.path, self.about, self.config = path, about, config
        self._env, self._trust = env, trust
        self.metrics = MetricsFile(path / "metrics.csv")
        self.way_on = (
            "make it again" if about["distilled"] else f"go on with: sympol resume {self.as_argument}"
        )
        """What to do once a disk that failed works again."""
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
        """Make the folder and write its config; of a tree that was ``distilled``, by what.

        Of a training that starts from a tree, the tree is written, too. ``flag`` is what messages call the path.

        Raises:
            RunError: it exists and is not to be overwritten, or is not a run, or another process writes in it, or it
                cannot be written.
        """
        flag = flag or _flag(bool(distilled))

        def check() -> None:
            require_free(path, overwrite=overwrite, distilled=bool(distilled), flag=flag)

        check()
        begun_with = {} if start is None else start.about()
        about = describe(spec, seed, preset, eval_episodes, distilled or {}, begun_with)
        text = to_toml(about, {} if distilled else config.to_dict())
        run = cls(path, about, config)
        try:
            path.mkdir(parents=True, exist_ok=True)
            run.take(flag)
            check()  # again: another process may have made a run meanwhile
            _clear(path)
            if start is not None:
                files.write(path / _START, start.tree.to_json())
            files.write(path / CONFIG, text)
        except OSError as error:
            run.close()
            raise RunError(f"cannot write {_place(error, path)}; choose another {flag}") from error
        except BaseException:
            run.close()
            raise
        return run

    def take(self, flag: str | None = None) -> None:
        """Become the only process that writes in the folder; what killed ones left unfinished there is removed.

        ``flag`` is how another folder can be chosen, where that is a way out.

        Raises:
            RunError: another process writes in it.
            OSError: it cannot be written.
        """
        if self._lock is not None:
            return
        try:
            self._lock = FolderLock(self.path)
        except Held as error:
            raise _written_by(str(error), self.path, flag) from None
        for folder in (self.path, self.path / "checkpoints"):
            if folder == self.path or not folder.is_symlink():
                files.remove_temporaries(folder)

    def close(self) -> None:
        """Let other processes write in the folder; the lock's file stays where no config was written (`_is_unused`)."""
        if self._lock is not None:
            self._lock.release(remove=(self.path / CONFIG).exists())
            self._lock = None

    def __enter__(self) -> Self:
        """It is closed at the end."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    @classmethod
    def open(cls, path: Path, env: Any = None, *, trust: bool = False) -> Run:
        """Read a run's config.

        Args:
            path: The folder.
            env: The environment to use in place of the one that the folder names, as in `resolve`.
            trust: Whether a module that the folder names may be imported, which runs its code.

        Raises:
            RunError: there is no run, or it has another format.
        """
        return cls(path, *read(path), env, trust=trust)

    @property
    def seed(self) -> int:
        """The training's seed."""
        return int(self.about["seed"])

    @property
    def as_argument(self) -> str:
        """The folder as a command that plays episodes takes it, with --trust if its environment needs a module."""
        return shlex.quote(str(self.path)) + (" --trust" if ":" in self.about["env"] else "")

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
            tree = DecisionTree.from_json(files.read_text(file, files.MOST))
            return Start.from_about(tree, self.about["start"])
        except (OSError, TypeError, ValueError, KeyError, OverflowError) as error:
            raise RunError(
                f"{self.path} started from a tree, which cannot be read in {file}: {error}"
            ) from error

    def resolve_env(self) -> EnvSpec:
        """Return the environment the run was made on, or the one it was opened with, under the names of the run.

        Naming the run's own id means its environment, with the arguments and wrappers that the folder keeps.

        Where Numba is not installed a run that trained with its machine code can be read, and only refuses to train on.

        Raises:
            RunError: the folder does not say all of the environment, no such id is known here, or it needs a module
                that may not be imported.
        """
        names = {name: self.about[name] for name in ("feature_names", "action_names", "groups")}
        if isinstance(self._env, EnvSpec):
            return self._env
        is_named = isinstance(self._env, str) and _id(self._env) == _id(self.about["env"])
        if self._env is not None and not is_named:
            return resolve(self._env, **names)
        backend = self.about["backend"]
        remedy = (
            "give the environment itself: sympol.load(path, env=...), or on the command line --env module:Id"
        )
        name: str = self._env if isinstance(self._env, str) else self.about["env"]
        origin = Origin.from_dict(self.about)
        if origin.not_kept:
            raise RunError(f"{self.path} was trained on {name}, {origin.not_kept}; {remedy}")
        require_no_import(name, self.path, trust=self._trust or is_named)
        try:
            spec = resolve(
                name,
                env_kwargs=origin.env_kwargs,
                wrappers=origin.wrappers,
                backend=backend,
                require_installed=False,
                **names,
            )
        except UnknownEnvironment as error:
            raise RunError(
                f"{self.path} was trained on {name!r}, which is not known here; register it with "
                f"sympol.register, or {remedy}"
            ) from error
        except (TypeError, ValueError) as error:
            raise RunError(f"{self.path / CONFIG}: {error}") from error
        return spec.trained_with(self.config.num_envs)

    @contextlib.contextmanager
    def writing(self) -> Iterator[None]:
        """Within it a failing disk is a WriteError that names the file and says how to go on.

        Raises:
            WriteError: see there.
        """
        try:
            yield
        except OSError as error:
            repair = _REPAIRS.get(error.errno or 0, "see to that")
            raise WriteError(
                f"cannot write {_place(error, self.path)}; {repair}, then {self.way_on}"
            ) from error

    def require_own_checkpoints(self) -> None:
        """Raise RunError where checkpoints would be written through a link, into a folder that is somebody else's."""
        folder = self.path / "checkpoints"
        if folder.is_symlink():
            raise RunError(
                f"{folder} is a link to {os.path.realpath(folder)}, and a run writes only in its own folder; put a "
                "folder in the place of the link, with a copy of the files in the other"
            )

    def save_checkpoint(self, state: TrainState) -> None:
        """Write the state of the training.

        Raises:
            RunError: it cannot be written.
        """
        self.require_own_checkpoints()
        with self.writing():
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
        """Write the tree in every form.

        Raises:
            RunError: it cannot be written.
        """
        self._write("policy.json", tree.to_json())
        self._write("policy.py", tree.to_python())
        self._write("tree.txt", tree.to_text() + "\n")
        with self.writing():
            tree.plot(self.path / "tree.svg")

    def is_finished(self) -> bool:
        """Whether all that is written at the end of a training is there, and whole."""
        try:
            if self.load_summary() is None:
                return False
            if self.has_tree:
                self.load_tree()
        except RunError:
            return False
        return not self.has_tree or all((self.path / name).is_file() for name in _FORMS)

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
        """What came of it, if it is finished.

        Raises:
            RunError: it is damaged.
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
        """Write what came of it.

        Raises:
            RunError: it cannot be written.
        """
        self._write("summary.json", json.dumps(summary, indent=2) + "\n")

    def _write(self, name: str, text: str) -> None:
        with self.writing():
            files.write(self.path / name, text)


def require_free(path: Path, *, overwrite: bool, distilled: bool = False, flag: str | None = None) -> None:
    """Raise RunError where no run can be made.

    That is at a file, in something else's folder, where another process writes, or at a run that is not to be replaced.
    """
    flag = flag or _flag(distilled)
    if path.exists() and not path.is_dir():
        raise RunError(f"{path} is a file; choose another {flag}")
    for folder in (path, *(path / "distilled").glob("*")):
        if (writer := writer_of(folder)) is not None:
            raise _written_by(writer, folder, flag)
    if path.is_dir() and not _is_unused(path):
        if not is_run(path / "config.toml"):
            raise RunError(f"{path} exists and is not a sympol run; choose another {flag}")
        if not overwrite:
            go_on = "" if distilled else f"continue it with `sympol resume {path}`, "
            raise RunError(
                f"{path} already holds a run; {go_on}replace it with --overwrite, or choose another {flag}"
            )
        for name in (*_MADE, CONFIG, _START):
            if (path / name).is_dir() and not (path / name).is_symlink():
                raise RunError(
                    f"{path / name} is a folder, and a file of the run belongs there; move it away, or choose another "
                    f"{flag}"
                )


def _is_unused(path: Path) -> bool:
    """Whether a folder is empty, or holds only what a process left that was killed before it wrote the config."""
    names = set(os.listdir(path))
    unfinished = {name for name in names if name == LOCK or files.is_temporary(name)}
    rest = names - unfinished
    if LOCK in names:  # only a run's folder has one: what is there besides has stayed when a run was replaced
        return not rest & {CONFIG, *_MADE} and not has_checkpoints(path / "checkpoints")
    return not rest or (bool(unfinished) and rest == {_START})


def _clear(path: Path) -> None:
    """Remove a run, and leave what others have put beside and into its folders.

    The config goes last: a process killed meanwhile leaves a run without results, or what `_is_unused`.
    """
    remove_all(path / "checkpoints")
    for folder, pattern in ((path / "distilled", "*"), (path / "tensorboard", "events.out.tfevents.*")):
        if folder.is_symlink():
            folder.unlink()
            continue
        for made in folder.glob(pattern):
            if not made.is_dir():
                made.unlink()
            elif not made.is_symlink() and is_run(made / CONFIG):
                _clear(made)
                _remove_if_empty(made)
        _remove_if_empty(folder)
    for name in (*_MADE, CONFIG, _START):
        (path / name).unlink(missing_ok=True)


def _id(env: str) -> str:
    """An environment's id without the module that registers it."""
    return env.rpartition(":")[2]


def _remove_if_empty(folder: Path) -> None:
    with contextlib.suppress(OSError):
        folder.rmdir()


def _flag(distilled: bool) -> str:
    return "--out" if distilled else "--run-dir"


def _written_by(writer: str, path: Path, flag: str | None) -> RunError:
    another = "" if flag is None else f", or choose another {flag}"
    return RunError(f"{path} is being written by {writer}; wait until it has ended{another}")


def _place(error: OSError, path: Path) -> str:
    return f"{error.filename or path}: {error.strerror or error}"
