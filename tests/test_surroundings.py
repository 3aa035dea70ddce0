"""Without a home, with a folder that cannot be written, with a full disk: nothing is kept, and everything works."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

import sympol
from sympol.compilation import cache_folder

from .tiny import TRAIN


@pytest.fixture
def no_home(monkeypatch: pytest.MonkeyPatch) -> None:
    def nobody(user: object) -> None:
        raise KeyError(user)

    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.setattr("pwd.getpwuid", nobody)


def test_the_home_is_asked_for_only_where_no_folder_is_named(monkeypatch, no_home, tmp_path):
    with pytest.raises(RuntimeError):
        Path.home()
    monkeypatch.setenv("SYMPOL_CACHE_DIR", str(tmp_path / "cache"))
    assert cache_folder() == tmp_path / "cache"
    monkeypatch.setenv("SYMPOL_CACHE_DIR", "")
    assert cache_folder() is None
    monkeypatch.delenv("SYMPOL_CACHE_DIR")
    assert cache_folder() is None


def test_a_home_that_cannot_be_written_keeps_nothing_and_says_nothing(monkeypatch, tmp_path):
    monkeypatch.delenv("SYMPOL_CACHE_DIR", raising=False)
    monkeypatch.setenv("HOME", os.devnull)
    assert cache_folder() is None
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder() == tmp_path / ".cache" / "sympol"
    assert list((tmp_path / ".cache" / "sympol").iterdir()) == []


def test_a_folder_that_was_named_and_cannot_be_used_is_warned_of(monkeypatch):
    monkeypatch.setenv("SYMPOL_CACHE_DIR", f"{os.devnull}/cache")
    with pytest.warns(UserWarning, match=r"not kept: SYMPOL_CACHE_DIR is /dev/null/cache, .*Not a directory"):
        assert cache_folder() is None


def test_a_full_disk_keeps_nothing(monkeypatch, tmp_path):
    import resource  # a limit on the size of files stands in for the disk: writing fails as it does on a full one
    import signal

    monkeypatch.setenv("SYMPOL_CACHE_DIR", str(tmp_path))
    before, handler = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with warnings.catch_warnings(record=True):
            warnings.simplefilter("always")
            kept = cache_folder()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
    assert kept is None
    assert list(tmp_path.iterdir()) == []


def test_machine_code_runs_where_it_cannot_be_kept(monkeypatch, tmp_path):
    pytest.importorskip("numba")
    from sympol.envs.lunar_lander import machine

    folder = tmp_path / "kept"
    folder.mkdir()
    monkeypatch.setattr(machine, "_FOLDER", str(folder))
    add = machine.compiled(_add)
    shutil.rmtree(folder)
    folder.write_text("in the way")  # as a disk that has become full since, writing fails
    assert add(2, 3) == 5


def _add(a, b):
    return a + b


def as_nobody(folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """`sympol train` as a container starts it: a user id without a name, and hardly any environment."""
    given = {
        "PATH": os.environ["PATH"],
        "PYTHONPATH": str(Path(sympol.__file__).parents[1]),
        "JAX_DISABLE_MOST_OPTIMIZATIONS": "true",
        **environment,
    }
    command = [
        "unshare",
        "-U",
        "--map-user=54321",
        "--map-group=54321",
        sys.executable,
        "-m",
        "sympol",
        "train",
    ]
    return subprocess.run(
        [*command, *TRAIN], cwd=folder, env=given, capture_output=True, text=True, check=False
    )


def can_be_nobody() -> bool:
    try:
        command = ["unshare", "-U", "--map-user=54321", "--map-group=54321", "true"]
        return subprocess.run(command, capture_output=True, check=False).returncode == 0
    except OSError:
        return False


@pytest.mark.slow
@pytest.mark.parametrize("named", [True, False])
def test_an_unknown_user_without_a_home_trains_and_hears_nothing_of_it(tmp_path, named):
    if not can_be_nobody():
        pytest.skip("no user namespaces here")
    tmp_path.chmod(0o777)
    done = as_nobody(tmp_path, **({"SYMPOL_CACHE_DIR": str(tmp_path / "cache")} if named else {}))
    assert done.returncode == 0, done.stderr
    assert all(line.startswith("training ") for line in done.stderr.splitlines()), done.stderr
    assert (tmp_path / "runs" / "CartPole-v1-1" / "tree.svg").exists()
    assert any((tmp_path / "cache").iterdir()) == named if named else not (tmp_path / "cache").exists()
