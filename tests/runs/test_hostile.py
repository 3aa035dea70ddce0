"""A run's folder that somebody made to do harm: one line, status 2, no hang, bounded memory, a clean terminal."""

from __future__ import annotations

import json
import os
import resource
from pathlib import Path

import pytest

import sympol
from sympol.runs import checkpoint

from ..tiny import quick_compiles, refused, status_of

__all__ = ["quick_compiles"]


@pytest.fixture(autouse=True)
def bounded():
    """No file may take more than 4 GB beside what is already there."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + 2**32, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


CONFIG = {
    "nested lists": "a = " + "[" * 100_000,
    "nested tables": "a = " + "{b=" * 100_000,
    "a long key": ".".join("a" * 100_000) + " = 1",
    "a long header": f"[{'.'.join('a' * 100_000)}]",
    "many quotes": 'a = "' + '\\"' * 500_000,
    "a huge number": "seed = " + "9" * 100_000,
    "a list": "run = []\nconfig = []",
    "tables in a list": "[[run]]\n[[config]]",
    "no text": "\udcff\udcfe\x00",
    "nothing": "",
}


@pytest.mark.parametrize("content", CONFIG.values(), ids=CONFIG)
def test_a_hostile_config_is_one_line(run, capsys, content):
    (run / "config.toml").write_bytes(content.encode(errors="surrogateescape"))
    capsys.readouterr()
    for command in ("show", "resume"):
        said = refused(capsys, command, run)
        assert "config.toml" in said
        assert len(said) < 600


VALUES = (
    "nan", "inf", "-1", "4294967296", "0x" + "f" * 30_000, "1.5", "true", "'x'", "[]", "[0]", "{}", "{a = {b = [{}]}}",
    "1979-05-27", "'\\u001b'",
)  # fmt: skip


@pytest.mark.parametrize("value", VALUES)
@pytest.mark.parametrize(
    "name", ["seed", "eval_episodes", "format", "feature_names", "groups", "distilled", "depth"]
)
def test_a_wrong_value_is_one_line(run, capsys, name, value):
    file = run / "config.toml"
    lines = file.read_text().split("[run]\n")
    if name == "depth":
        text = file.read_text().replace("depth = 3", f"depth = {value}")
    else:
        kept = [line for line in lines[1].splitlines() if not line.startswith(f"{name} =")]
        text = f"{lines[0]}[run]\n{name} = {value}\n" + "\n".join(kept)
    if (name, value) in (
        ("feature_names", "[]"),
        ("groups", "[]"),
        ("distilled", "{}"),
        ("feature_names", "[0]"),
    ):
        return
    if name == "feature_names" and "feature_names = [\n" in text:
        head, _, rest = text.partition("feature_names = [\n")
        text = head + rest.partition("]\n")[2]
    file.write_text(text)
    capsys.readouterr()
    said = refused(capsys, "resume", run)
    assert len(said) < 700


@pytest.mark.parametrize("name", ["config.toml", "policy.json", "summary.json"])
@pytest.mark.parametrize("kind", ["pipe", "zeros", "folder", "large"])
def test_what_is_no_ordinary_file_is_not_read(run, capsys, name, kind):
    (run / name).unlink()
    if kind == "pipe":
        os.mkfifo(run / name)
    elif kind == "zeros":
        (run / name).symlink_to("/dev/zero")
    elif kind == "folder":
        (run / name).mkdir()
    else:
        with open(run / name, "wb") as file:
            file.truncate(2**36)
    capsys.readouterr()
    assert name in refused(capsys, "show", run)


SUMMARIES = ("[" * 100_000, '{"return_mean": ' + "9" * 5000 + "}", '{"nodes": []}', '{"nodes": "\\u001b[2J"}', "[[]]",
             '{"return_mean": 1' + "0" * 400 + "}", '{"return_mean": true}', '{"timesteps": {"a": ' * 200)  # fmt: skip


@pytest.mark.parametrize("content", SUMMARIES, ids=range(len(SUMMARIES)))
def test_a_hostile_summary_is_one_line(run, capsys, content):
    (run / "summary.json").write_text(content)
    capsys.readouterr()
    said = refused(capsys, "show", run)
    assert "summary.json" in said
    assert "\x1b" not in said


SEALS = ("[" * 50_000, "[]", "null", '{"timestep": 1e999, "sha256": "a"}', '{"timestep": NaN, "sha256": "a"}',
         '{"timestep": -1, "sha256": "a"}', '{"timestep": "2048", "sha256": ["a"]}',
         '{"timestep": true, "sha256": "a"}',
         '{"timestep": ' + "9" * 5000 + ', "sha256": "a"}', '{"a":' + " " * 100_000 + "1}", "\x00")  # fmt: skip


@pytest.mark.parametrize("content", SEALS, ids=range(len(SEALS)))
def test_a_hostile_seal_is_a_damaged_checkpoint(run, content):
    newest = max((run / "checkpoints").glob("*.json"))
    newest.write_text(content)
    with pytest.warns(checkpoint.DamagedCheckpoint, match=newest.stem):
        assert 0 < sympol.load(run).num_timesteps < 2048


def test_a_huge_checkpoint_is_not_read(run):
    newest = max((run / "checkpoints").glob("*.safetensors"))
    with open(newest, "r+b") as file:
        file.truncate(2**36)
    with pytest.warns(checkpoint.DamagedCheckpoint, match="larger than .* MiB"):
        sympol.load(run)


STARTS = ("[" * 50_000, "{}", "[]", '{"a": NaN}', "\x00")


@pytest.mark.parametrize("content", STARTS, ids=range(len(STARTS)))
def test_a_hostile_tree_to_start_from_is_one_line(run, capsys, content):
    (run / "start.json").write_text(content)
    text = (run / "config.toml").read_text()
    (run / "config.toml").write_text(
        text.replace("[config]", '[run.start]\norigin = "x"\nfreeze = []\n\n[config]')
    )
    capsys.readouterr()
    assert "start.json" in refused(capsys, "resume", run)


def test_escape_sequences_never_reach_the_terminal(run, capsys):
    text = (run / "config.toml").read_text()
    evil = '"\\u001b]0;pwned\\u0007\\u001b[2J"'
    hostile = [
        text.replace('sympol = "0.1.0"', f"sympol = {evil}", 1),
        text.replace("format = 1", f"format = {evil}", 1),
        text.replace('preset = "default"', f"preset = {evil}", 1),
        text.replace("[config]", f"[run.distilled]\nteacher = {evil}\nmethod = {evil}\n\n[config]", 1),
        text.replace("depth = 3", f"{evil} = 3", 1),
        text.replace("seed = 0", f"seed = {evil}", 1),
    ]
    tree = json.loads((run / "policy.json").read_text())
    capsys.readouterr()
    for content in hostile:
        assert content != text
        (run / "config.toml").write_text(content)
        for command in ("show", "resume", "export", "distill"):
            status_of(command, run)
            said = capsys.readouterr()
            assert "\x1b" not in said.err
            assert "\x07" not in said.err
            assert "\x1b" not in said.out
    assert tree
