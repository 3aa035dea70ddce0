"""A run's folder: made safely, read with suspicion."""

from __future__ import annotations

import hashlib
import json
import pickle
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import sympol
from sympol.runs import checkpoint
from sympol.runs.metadata import RunError
from sympol.runs.metrics import MetricsFile
from sympol.runs.run import Run

from ..tiny import COLUMNS, TRAIN, agent, csv_without_time, quick_compiles, refused, status_of

__all__ = ["quick_compiles"]


def newest(run: Path) -> list[Path]:
    return sorted((run / "checkpoints").glob("*.safetensors"), reverse=True)


def seal(file: Path, content: bytes) -> None:
    """Write a file with the checksum that fits it."""
    file.write_bytes(content)
    about = {"timestep": int(file.stem), "sha256": hashlib.sha256(content).hexdigest()}
    file.with_suffix(".json").write_text(json.dumps(about))


def truncate(file: Path) -> None:
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


def flip(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


@pytest.mark.parametrize("damage", [truncate, flip, Path.unlink, lambda file: file.write_bytes(b"")])
def test_a_damaged_checkpoint_is_noticed_and_the_one_before_used(run, finished, damage, capsys):
    damage(newest(run)[0])
    before = int(newest(run)[-1].stem)
    with pytest.warns(checkpoint.DamagedCheckpoint, match="damaged checkpoint skipped: "):
        assert sympol.load(run).num_timesteps == before
    capsys.readouterr()
    assert status_of("resume", run) == 0
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith("warning: damaged checkpoint skipped: 00000000")
    assert lines[1] == f"resuming at step {before:,} of 2,048"
    for file in ("policy.json", "policy.py", "tree.txt"):
        assert (run / file).read_bytes() == (finished / file).read_bytes()
    assert csv_without_time(run) == csv_without_time(finished)


def test_when_both_are_damaged_it_says_so(run, capsys):
    for file in newest(run):
        flip(file)
    capsys.readouterr()
    line = refused(capsys, "resume", run)
    assert "no usable checkpoint" in line
    assert line.count("checksum does not match") == 2
    assert status_of("show", run) == 0  # the tree is whole


@pytest.mark.parametrize(
    "content", ["[]", "{}", '{"sha256": 3}', "{", '{"timestep": 1, "sha256": "0"}', "\x00"]
)
def test_a_strange_seal_is_a_damaged_checkpoint(run, content):
    newest(run)[0].with_suffix(".json").write_text(content)
    with pytest.warns(checkpoint.DamagedCheckpoint):
        sympol.load(run)


def test_a_sealed_stranger_is_a_damaged_checkpoint(run):
    """Whole by its checksum, but not this training's state."""
    folder = run / "checkpoints"
    checkpoint.save(folder, {"weights": np.zeros(3)}, 10**9)
    seal(folder / "999999999999.safetensors", b"no tensors")
    with pytest.warns(checkpoint.DamagedCheckpoint, match="999999999999.*001000000000"):
        sympol.load(run)


class Malice:
    """Unpickled, it would leave a file behind."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self):
        return (open, (str(self.mark), "w"))


def test_nothing_is_ever_unpickled(run, tmp_path, capsys):
    mark = tmp_path / "pwned"
    payload = pickle.dumps(Malice(mark))
    folder = run / "checkpoints"
    for name in ("000000009999", "000000009998"):
        seal(folder / f"{name}.safetensors", payload)
    np.savez(folder / "000000009997.npz", x=np.array([Malice(mark)], object), allow_pickle=True)
    shutil.copy(folder / "000000009997.npz", folder / "000000009997.safetensors")
    (run / "state.pkl").write_bytes(payload)
    with pytest.warns(checkpoint.DamagedCheckpoint):
        sympol.load(run)
    for file in ("policy.json", "summary.json", "config.toml"):
        (run / file).write_bytes(payload)
        for command in ("show", "eval", "resume", "export"):
            status_of(command, run)
    capsys.readouterr()
    assert not mark.exists()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("format = 1", "format = 2", r"made by sympol 0.1.0 in format 2; this is sympol"),
        ("[run]", "[run", "config.toml cannot be read"),
        ("[run]", "[walk]", r"it lacks \[run\]"),
        ("[config]", "[settings]", r"it lacks \[config\]"),
        ("seed = 0", 'seed = "zero"', "seed must be a int, got 'zero'"),
        ("seed = 0", "", "seed must be a int, got None"),
        ("depth = 3", "depth = 77", "depth must be between 1 and 14, got 77"),
        ("depth = 3", "deepness = 3", "unknown config field 'deepness'"),
        ('env = "CartPole-v1"', 'env = "CartPoel-v1"', "trained on 'CartPoel-v1', which is not known here"),
        ('"push left",', "", "action_names must have 2 names, got 1"),
        ('"push left",', "3,", "action_names must be a list"),
        ('sympol = "0.1.0"', 'sympol = "0.0.9"', "continue only in the version that made them"),
    ],
)
def test_a_broken_config_is_one_line(run, capsys, old, new, message):
    file = run / "config.toml"
    file.write_text(file.read_text().replace(old, new, 1))
    capsys.readouterr()
    assert re.search(message, refused(capsys, "resume", run))


@pytest.mark.parametrize(
    ("file", "content", "commands"),
    [
        ("policy.json", "{", ("show", "eval", "export")),
        ("policy.json", '{"format": "sympol.tree", "version": 99}', ("show", "eval", "export")),
        ("policy.json", None, ("show", "eval", "export")),
        ("summary.json", "{", ("show",)),
        ("summary.json", "[]", ("show",)),
        ("summary.json", '{"return_mean": "much"}', ("show",)),
        ("config.toml", "\x00", ("show", "eval", "export", "resume")),
        ("config.toml", None, ("show", "eval", "export", "resume")),
        ("config.toml", "run = 1\nconfig = 2", ("show", "resume")),
    ],
)
def test_a_broken_file_is_one_line(run, capsys, file, content, commands):
    if content is None:
        (run / file).unlink()
    else:
        (run / file).write_text(content)
    capsys.readouterr()
    for command in commands:
        assert file in refused(capsys, command, run)


def test_what_is_no_run_is_never_replaced(tmp_path, capsys):
    (tmp_path / "config.toml").write_text("[package]\n")
    (tmp_path / "src").mkdir()
    for extra in ((), ("--overwrite",)):
        assert "exists and is not a sympol run" in refused(
            capsys, "train", *TRAIN, "--run-dir", tmp_path, *extra
        )
    assert sorted(p.name for p in tmp_path.iterdir()) == ["config.toml", "src"]


def test_a_run_is_replaced_only_when_asked(run, capsys):
    (run / "notes.md").write_text("mine")
    before = (run / "policy.json").read_bytes()
    capsys.readouterr()
    line = refused(capsys, "train", *TRAIN, "--seed", "5", "--run-dir", run)
    assert "already holds a run; continue it with `sympol resume" in line
    assert (run / "policy.json").read_bytes() == before
    assert status_of("train", *TRAIN, "--seed", "5", "--run-dir", run, "--overwrite") == 0
    assert (run / "policy.json").read_bytes() != before
    assert (run / "notes.md").read_text() == "mine"
    assert len((run / "metrics.csv").read_text().splitlines()) == 9


def test_resume_takes_no_other_settings(run, capsys):
    capsys.readouterr()
    line = refused(capsys, "train", *TRAIN, "--depth", "4", "--seed", "9", "--run-dir", run, "--resume")
    assert "was begun with seed 0, not 9, depth 3, not 4; to resume it as it was: sympol resume" in line
    line = refused(capsys, "train", *TRAIN, "--resume")
    assert "--resume needs" in line
    assert "--run-dir" in line
    assert status_of("train", *TRAIN, "--run-dir", run, "--resume") == 0


@pytest.mark.parametrize("where", ["file", "file/run", "/proc/sympol/run"])
def test_a_place_that_cannot_be_written_is_one_line(tmp_path, capsys, where):
    (tmp_path / "file").write_text("mine")
    path = tmp_path / where
    line = refused(capsys, "train", *TRAIN, "--run-dir", path)
    assert "choose another --run-dir" in line
    assert (tmp_path / "file").read_text() == "mine"


class Killed(BaseException):
    """Nothing catches it: as if the process ended here."""


@pytest.mark.parametrize("at", range(2, 22, 3))
@pytest.mark.parametrize("renamed", [False, True])
def test_killed_at_any_write_it_ends_in_the_same_run(finished, tmp_path, monkeypatch, at, renamed):
    """Every file is written under another name, then renamed; the kill comes just before or after the rename."""
    left = at

    def replace(source, target, *, really=checkpoint.os.replace):
        nonlocal left
        left -= 1
        if left == 0 and not renamed:
            raise Killed
        really(source, target)
        if left == 0:
            raise Killed

    monkeypatch.setattr(checkpoint.os, "replace", replace)
    run = tmp_path / "run"
    with pytest.raises(Killed):
        status_of("train", *TRAIN, "--run-dir", run)
    left = 3
    with pytest.raises(Killed):
        status_of("resume", run)
    left = 0
    assert status_of("resume", run) == 0
    for file in ("policy.json", "policy.py", "tree.txt", "tree.svg"):
        assert (run / file).read_bytes() == (finished / file).read_bytes(), file
    assert csv_without_time(run) == csv_without_time(finished)


def test_a_torn_row_is_dropped(tmp_path):
    metrics = MetricsFile(tmp_path / "metrics.csv")
    row = dict.fromkeys(COLUMNS, 0.25)
    for step in (100, 200, 300):
        metrics.append({**row, COLUMNS[0]: step})
    whole = (tmp_path / "metrics.csv").read_bytes()
    for cut in range(1, 40):
        (tmp_path / "metrics.csv").write_bytes(whole[:-cut])
        assert [r[COLUMNS[0]] for r in metrics.read()] == [100, 200]
    metrics.forget_after(200)
    metrics.append({**row, COLUMNS[0]: 300})
    assert (tmp_path / "metrics.csv").read_bytes() == whole
    metrics.forget_after(0)
    assert not (tmp_path / "metrics.csv").exists()
    metrics.forget_after(0)


def test_only_the_newest_two_checkpoints_are_kept(finished):
    assert len(list((finished / "checkpoints").iterdir())) == 2 * checkpoint.KEPT == 4


def test_a_name_is_only_a_name_in_the_config(tmp_path):
    names = ("a\nb", 'c" = 1', "[run]", "\\ud \U0001f600 ü")
    run = Run.create(tmp_path / "run", agent(feature_names=names).spec, agent().config, 0)
    again = Run.open(run.path)
    assert again.metadata["feature_names"] == list(names)
    assert again.metadata["feature_names"] == run.metadata["feature_names"]


def test_a_name_that_is_no_text_is_refused(tmp_path):
    with pytest.raises((ValueError, RunError)):
        Run.create(tmp_path / "run", agent(feature_names=("\ud800", "b", "c", "d")).spec, agent().config, 0)
