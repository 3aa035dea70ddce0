"""The provenance of a result: package versions, the commit, and a hash of the code that runs."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.util
import platform
import subprocess
from pathlib import Path

from .threads import threads
from .version import __version__

_PACKAGE = Path(__file__).parent
_RESULTS_DEPEND_ON = ("jax", "jaxlib", "equinox", "optax", "gymnasium", "numpy")
_TRAINING_DEPENDS_ON = ("sympol", "jax", "jaxlib")


def versions() -> dict[str, str]:
    """Return the version of everything a result may depend on, by name."""
    numba = ("numba",) if importlib.util.find_spec("numba") is not None else ()
    return {
        "python": platform.python_version(),
        "sympol": __version__,
        **_installed(*_RESULTS_DEPEND_ON, *numba),
    }


def training_versions() -> dict[str, str]:
    """Return the versions that two machines must share for their trainings to agree.

    They come from the metadata of the installed packages, as Dask reports them for its workers; a package without
    metadata has the version ``"none"``.
    """
    return {"python": ".".join(platform.python_version_tuple()[:2]), **_installed(*_TRAINING_DEPENDS_ON)}


def environment_fingerprint() -> dict[str, str]:
    """Return everything two processes must share for their results to be the same.

    Beside `training_versions`, these are a hash of the code and the number of threads.
    """
    return {**training_versions(), "code": code_hash(), "threads": str(threads())}


@functools.cache
def code_hash() -> str:
    """Return a short hash of sympol's own files; two checkouts of one version may differ in it."""
    digest = hashlib.sha256()
    for file in sorted(file for ending in ("py", "toml") for file in _PACKAGE.rglob(f"*.{ending}")):
        name = file.relative_to(_PACKAGE.parent).as_posix()
        digest.update(name.encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:12]


@functools.cache
def commit() -> str:
    """Return the commit of the running sources, followed by "+" if they differ from it.

    Outside a git repository the answer is empty. It is read once: sources may change while they run.
    """

    def git(*arguments: str) -> str:
        done = subprocess.run(["git", *arguments], cwd=_PACKAGE, capture_output=True, text=True, check=False)
        return done.stdout.strip() if done.returncode == 0 else ""

    with contextlib.suppress(OSError):
        changed = git("status", "--porcelain", "--untracked-files=no", str(_PACKAGE))
        return f"{git('rev-parse', 'HEAD')}{'+' if changed else ''}"
    return ""


def _installed(*packages: str) -> dict[str, str]:
    """Return the installed version of each package, ``"none"`` for one that is not installed."""
    from importlib.metadata import PackageNotFoundError, version  # slow to import

    found = {}
    for package in packages:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "none"
    return found
