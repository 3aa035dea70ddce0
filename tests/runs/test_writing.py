"""Files are written whole or not at all, and by one process at a time."""

from __future__ import annotations

import contextlib
import json
import os
import resource
import shutil
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import sympol
from sympol import files
from sympol.runs.lock import LOCK, FolderLock, exclusive
from sympol.runs.metadata import RunError
from sympol.runs.run import Run

from ..tiny import TRAIN, agent, csv_without_time, quick_compiles, refused, status_of

__all__ = ["quick_compiles"]

HOLD = """
import sys, time
from pathlib import Path
from sympol.runs.run import Run
run = Run.open(Path(sys.argv[1]))
run.take()
print("held", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def unfinished(run) -> Path:
    """One that was stopped before its last checkpoint was written, and before there were results."""
    for file in (*(run / "checkpoints").glob("*2048.*"), run / "summary.json"):
        file.unlink()
    return run


def state_of(folder: Path) -> dict[str, tuple[bytes, int]]:
    """Every file's content and time."""
    return {
        str(file.relative_to(folder)): (file.read_bytes(), file.stat().st_mtime_ns)
        for file in folder.rglob("*")
        if file.is_file()
    }


def held(run: Path) -> subprocess.Popen[str]:
    """A process that writes in the run until its input ends."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(run)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    return process


def test_a_run_that_another_process_writes_is_refused_but_read(unfinished, capsys):
    run, before = unfinished, state_of(unfinished)
    process = held(run)
    try:
        capsys.readouterr()
        by = f"{run} is being written by process {process.pid} on "
        for words in (
            ("resume", run),
            ("train", *TRAIN, "--run-dir", run),
            ("train", *TRAIN, "--run-dir", run, "--resume"),
            ("train", *TRAIN, "--run-dir", run, "--overwrite"),
            ("distill", "builtins:max", "--env", "CartPole-v1", "--out", run, "--overwrite"),
        ):
            assert by in refused(capsys, *words), words
        with pytest.raises(RunError, match=r"is being written by process \d+ on .*choose another path"):
            agent().save(run)
        assert status_of("show", run) == 0
        assert sympol.load(run).num_timesteps > 0
        after = state_of(run)
        assert {name: after[name] for name in before} == before
        process.kill()  # the operating system lets go of its lock
        process.wait()
        assert (run / LOCK).exists()
        assert status_of("resume", run) == 0
        assert not (run / LOCK).exists()
    finally:
        process.kill()
        process.communicate()


def test_a_process_may_save_into_the_run_that_it_writes(tmp_path):
    one = agent()
    with Run.create(tmp_path / "run", one.spec, one.config, 0) as run:
        one.save(run.path)
        assert (run.path / LOCK).exists()
    assert sorted(os.listdir(tmp_path / "run")) == ["config.toml"]


def test_a_forked_child_does_not_inherit_the_lock(tmp_path):
    """It must not hold the run when its parent is gone."""
    code = (
        "import os, sys; from pathlib import Path; from sympol.runs.lock import FolderLock\n"
        "lock = FolderLock(Path(sys.argv[1]))\n"
        "if os.fork() == 0:\n"
        "    os.read(0, 1)\n"
        "os._exit(0)"
    )
    with subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdin=subprocess.PIPE) as parent:
        assert parent.wait() == 0  # its child is still there: it waits for its input
        FolderLock(tmp_path).release()
    assert os.listdir(tmp_path) == []


def test_resuming_a_finished_run_changes_nothing(run, capsys):
    before, summary = state_of(run), json.loads((run / "summary.json").read_text())
    capsys.readouterr()
    assert status_of("resume", run, "--json") == 0
    said = capsys.readouterr()
    assert json.loads(said.out) == summary
    assert "is finished, and nothing in it is changed" in said.err
    assert status_of("train", *TRAIN, "--run-dir", run, "--resume") == 0
    assert status_of("resume", run, "--eval-episodes", "5") == 0
    assert f"other test episodes: sympol eval {run} --episodes 5" in capsys.readouterr().err
    assert state_of(run) == before


@pytest.mark.parametrize("name", ["policy.json", "tree.svg", "summary.json"])
def test_what_a_finished_run_lacks_is_written_again(run, finished, name):
    (run / name).unlink()
    assert status_of("resume", run) == 0
    if name != "summary.json":  # which has times
        assert (run / name).read_bytes() == (finished / name).read_bytes()
    assert (run / name).exists()


LINKED = (".metrics.csv.tmp", ".config.toml.tmp", ".tree.tmp.svg", ".policy.json.tmp", ".summary.json.tmp")
WRITTEN = ("metrics.csv", "policy.json", "policy.py", "tree.txt", "tree.svg", "summary.json")


def test_no_file_of_a_run_is_written_through_a_link(unfinished, tmp_path):
    run, mine = unfinished, tmp_path / "mine"
    mine.mkdir()
    for name in (*LINKED, *WRITTEN):
        (mine / name).write_text("mine")
        if name == "metrics.csv":
            shutil.copy(run / name, mine / name)
        (run / name).unlink(missing_ok=True)
        (run / name).symlink_to(mine / name)
    before = state_of(mine)
    assert status_of("resume", run) == 0
    assert state_of(mine) == before
    assert not any((run / name).is_symlink() for name in WRITTEN)


def test_nothing_is_written_into_a_linked_folder_of_checkpoints(unfinished, tmp_path, capsys):
    run, mine = unfinished, tmp_path / "mine"
    (run / "checkpoints").rename(mine)
    (run / "checkpoints").symlink_to(mine)
    before = state_of(tmp_path)
    capsys.readouterr()
    assert "is a link to " in refused(capsys, "resume", run)
    assert state_of(tmp_path) == before
    assert sympol.load(run).num_timesteps > 0
    assert status_of("train", *TRAIN, "--run-dir", run, "--overwrite") == 0
    assert state_of(mine) == {
        name.removeprefix("mine/"): it for name, it in before.items() if "mine/" in name
    }


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("tree.pdf", ("export", "--to", "pdf")),
        ("tree.png", ("export", "--to", "png")),
        ("a.py", ("export", "--to", "python", "--out", "a.py")),
        ("tree.onnx", ("export", "--to", "onnx")),
        ("report.html", ("report", "--episodes", "2")),
        ("episode.gif", ("watch", "--max-steps", "3")),
    ],
)
def test_no_page_picture_film_or_program_is_written_through_a_link(run, tmp_path, name, words, monkeypatch):
    if name == "tree.onnx":
        pytest.importorskip("onnx")
    monkeypatch.chdir(run)
    (tmp_path / "mine").write_text("mine")
    for link in (name, f".{name}.tmp", f".{Path(name).stem}.tmp{Path(name).suffix}"):
        (run / link).symlink_to(tmp_path / "mine")
    assert status_of(words[0], run, *words[1:]) == 0
    assert (tmp_path / "mine").read_text() == "mine"
    assert not (run / name).is_symlink()
    assert (run / name).stat().st_size > 100


def test_a_package_is_written_through_no_link(run, tmp_path):
    assert status_of("export", run, "--to", "package", "--out", tmp_path / "p") == 0
    assert not [file for file in (tmp_path / "p").rglob("*") if files.is_temporary(file.name)]


def test_a_device_is_written_to_and_not_replaced(run, tmp_path):
    code = f"from sympol.cli.app import main; main(['export', {str(run)!r}, '--out', '/dev/stdout'])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "def act(" in done.stdout
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    files.write(tmp_path / "pipe", "text")
    assert os.read(reader, 100) == b"text"
    os.close(reader)
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)


@pytest.mark.parametrize("umask", [0o022, 0o077])
def test_permissions_are_those_that_open_gives(tmp_path, umask):
    before = os.umask(umask)
    try:
        files.write(tmp_path / "new", "text")
        files.append(tmp_path / "appended", "text")
        (tmp_path / "old").write_text("old")
        (tmp_path / "old").chmod(0o640)
        files.write(tmp_path / "old", "text")
    finally:
        os.umask(before)
    modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("new", "appended", "old")]
    assert modes == [0o666 & ~umask, 0o666 & ~umask, 0o640]


def test_what_a_killed_process_left_is_removed(unfinished):
    run = unfinished
    nobody = subprocess.Popen([sys.executable, "-c", ""])
    nobody.wait()
    left = [
        run / f".sympol-{nobody.pid}-{'0' * 16}.tmp",
        run / "checkpoints" / f".sympol-{nobody.pid}-{'1' * 16}.tmp",
    ]
    mine = run / f".sympol-{os.getpid()}-{'2' * 16}.tmp"
    for file in (*left, mine):
        file.write_text("half")
    assert status_of("resume", run) == 0
    assert [file.exists() for file in (*left, mine)] == [False, False, True]


@pytest.mark.parametrize(
    "left",
    [
        (),
        (LOCK,),
        (LOCK, ".sympol-1-0123456789abcdef.tmp"),
        (".config.toml.tmp",),
        ("start.json", ".config.toml.tmp"),
        ("start.json", LOCK),
        ("notes.md", LOCK),
    ],
)
def test_a_folder_killed_in_its_first_write_can_be_used_again(tmp_path, left):
    for name in left:
        (tmp_path / name).touch()
    agent().save(tmp_path)
    assert sympol.load(tmp_path).num_timesteps == 0
    assert (tmp_path / "notes.md").exists() == ("notes.md" in left)


@pytest.mark.parametrize(
    "left", [("notes.md",), ("start.json",), ("policy.json", LOCK), ("notes.md", ".x.tmp")]
)
def test_somebody_else_s_folder_is_not(tmp_path, left):
    for name in left:
        (tmp_path / name).touch()
    with pytest.raises(RunError, match="is not a sympol run; choose another path"):
        agent().save(tmp_path)
    assert sorted(os.listdir(tmp_path)) == sorted(left)


def test_foreign_files_among_the_checkpoints_stay_and_count_for_nothing(unfinished, finished):
    folder = unfinished / "checkpoints"
    foreign = ("labels.json", "zzz.json", "9999999999999.json", "notes.safetensors", "000000000001.json")
    for name in foreign:
        (folder / name).write_text('{"mine": 1}')
    assert status_of("resume", unfinished) == 0
    names = {file.name for file in (finished / "checkpoints").iterdir()}
    assert {file.name for file in folder.iterdir()} == {*names, *foreign}
    assert (unfinished / "policy.json").read_bytes() == (finished / "policy.json").read_bytes()
    assert csv_without_time(unfinished) == csv_without_time(finished)
    assert status_of("train", *TRAIN, "--run-dir", unfinished, "--overwrite") == 0
    assert {file.name for file in folder.iterdir()} >= {*foreign} - {"000000000001.json"}


def test_a_folder_with_only_foreign_files_holds_no_checkpoint(run):
    shutil.rmtree(run / "checkpoints")
    (run / "checkpoints").mkdir()
    (run / "checkpoints" / "labels.json").write_text("{}")
    assert sympol.load(run).num_timesteps == 0


@contextlib.contextmanager
def largest_file(size: int) -> Iterator[None]:
    """A real limit on the size of files stands for the full disk: writing fails in the same way."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_disk_that_fails_in_a_training_is_one_line_with_the_way_on(unfinished, finished, capsys):
    run = unfinished
    checkpoint = max(file.stat().st_size for file in (run / "checkpoints").iterdir())
    before = sorted(os.listdir(run / "checkpoints"))
    with largest_file(checkpoint - 1):
        assert status_of("resume", run) == 1
    said = capsys.readouterr().err
    last = said.splitlines()[-1]
    assert last.startswith(f"error: cannot write {run / 'checkpoints'}/")
    assert last.endswith(f": File too large; see to that, then resume with: sympol resume {run}")
    assert "Traceback" not in said
    assert sorted(os.listdir(run / "checkpoints")) == before
    assert status_of("resume", run) == 0
    assert (run / "policy.json").read_bytes() == (finished / "policy.json").read_bytes()
    assert csv_without_time(run) == csv_without_time(finished)


def test_a_disk_that_fails_in_save_names_the_file_and_the_way_on(run, tmp_path):
    one, path = sympol.load(run), tmp_path / "saved"
    with largest_file(100), pytest.raises(RunError) as config:
        one.save(path)
    assert str(config.value) == f"cannot write {path / 'config.toml'}: File too large; choose another path"
    with largest_file(5000), pytest.raises(RunError) as checkpoint:
        one.save(path)  # into what the first one left
    assert f"cannot write {path / 'checkpoints'}/" in str(checkpoint.value)
    assert str(checkpoint.value).endswith("; see to that, then save it again, there or elsewhere")
    one.save(path)
    assert sympol.load(path).tree() == one.tree()


def test_a_row_that_does_not_fit_leaves_the_file_as_it_was(tmp_path):
    file = tmp_path / "file"
    files.append(file, "x" * 10)
    with largest_file(15), pytest.raises(OSError, match="File too large") as error:
        files.append(file, "y" * 10)
    assert (file.read_text(), error.value.filename) == ("x" * 10, str(file))


@pytest.mark.parametrize("name", ["metrics.csv", "tree.txt", "summary.json"])
def test_something_in_the_way_is_named(unfinished, capsys, name):
    (unfinished / name).unlink(missing_ok=True)
    (unfinished / name).mkdir()
    (unfinished / name / "mine").touch()
    capsys.readouterr()
    status = status_of("resume", unfinished)
    if name == "metrics.csv":  # moved aside, and said
        assert status == 0
        assert (unfinished / "metrics.unread.csv" / "mine").exists()
        assert "metrics.unread.csv" in capsys.readouterr().err
        return
    assert status == 1
    words = capsys.readouterr().err.splitlines()[-1]
    assert (
        f"cannot write {unfinished / name}: Is a directory; see to that, then resume with: sympol resume"
        in words
    )
    assert (unfinished / name / "mine").exists()


def test_a_search_that_goes_on_is_not_replaced(tmp_path, capsys):
    (tmp_path / "plan.json").write_text("{}")
    with exclusive(tmp_path, "search", "--out"):
        said = refused(capsys, "pareto", "CartPole-v1", "--out", tmp_path, "--overwrite")
    assert f"another search works in {tmp_path}: process {os.getpid()} on " in said
    assert (tmp_path / "plan.json").exists()


@pytest.mark.parametrize("name", ["start.json", "policy.json", "metrics.csv"])
def test_a_folder_in_the_place_of_a_file_is_refused_before_anything_is_removed(run, name, capsys):
    (run / name).unlink(missing_ok=True)
    (run / name).mkdir()
    before = state_of(run)
    said = refused(capsys, "train", *TRAIN, "--run-dir", run, "--overwrite")
    assert f"{run / name} is a folder, and a file of the run belongs there; move it away" in said
    assert state_of(run) == before
