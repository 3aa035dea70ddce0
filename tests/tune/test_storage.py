"""Storages of studies: a journal several processes write, a real PostgreSQL whose worker is killed, clear errors."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from pathlib import Path

import optuna
import pytest
from optuna.trial import TrialState

from sympol.tune import storage
from sympol.tune.storage import StorageError, open_storage

from .postgres import PASSWORD, Server, free_port, server

__all__ = ["server"]

ROOT = Path(__file__).parents[2]


def start_worker(*words: object) -> subprocess.Popen:
    command = [sys.executable, "-W", "error", "-m", "tests.tune.study_worker", *map(str, words)]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def finish(worker: subprocess.Popen) -> None:
    told, _ = worker.communicate(timeout=60)
    assert worker.returncode == 0, told


@pytest.mark.slow
def test_a_study_outlives_its_worker(server: Server, tmp_path):
    marker = tmp_path / "marker"
    # both at once in an empty database: two that make its tables
    victim, survivor = start_worker(server.url(), 10, marker), start_worker(server.url(), 10)
    end = time.monotonic() + 40
    while not marker.exists() or " " not in marker.read_text():
        assert victim.poll() is None, victim.communicate()
        assert time.monotonic() < end
        time.sleep(0.05)
    victim.kill()
    victim.communicate()
    finish(survivor)
    number = int(marker.read_text().split()[1])
    trials = optuna.load_study(study_name="s", storage=open_storage(server.url())).trials
    done = [trial for trial in trials if trial.state == TrialState.COMPLETE]
    assert len(done) == 10
    assert trials[number].state == TrialState.FAIL
    again = [trial for trial in done if trial.system_attrs.get("failed_trial") == number]
    assert [trial.params for trial in again] == [trials[number].params], (
        "tried again, with the same parameters"
    )


@pytest.mark.slow
def test_a_journal_takes_two_processes(tmp_path):
    path = tmp_path / "new" / "journal.log"
    for worker in [start_worker(path, 5), start_worker(path, 5)]:
        finish(worker)
    trials = optuna.load_study(study_name="s", storage=open_storage(path)).trials
    assert [trial.number for trial in trials] == [*range(len(trials))]
    assert 5 <= sum(trial.state == TrialState.COMPLETE for trial in trials) <= 6


def test_nothing_of_optuna_s_experiments_is_warned_of(server: Server, recwarn):
    open_storage(server.url())
    assert [*recwarn] == []


@pytest.mark.parametrize("scheme", ["postgres", "postgresql", "postgresql+psycopg"])
def test_each_spelling_of_postgresql(server: Server, scheme):
    assert open_storage(scheme + server.url().removeprefix("postgresql")).get_all_studies() is not None


@pytest.mark.parametrize(
    ("url", "words"),
    [
        (lambda server: server.url("missing"), 'database missing cannot be used: .*"missing" does not exist'),
        (lambda server: server.url(password="wr0ng"), "password authentication failed"),
        (
            lambda server: server.url(port=1),
            "host 127.0.0.1, port 1, database postgres.*[Rr]efused.*is it running",
        ),
        (lambda server: "postgresql://u:pw@no.such.host.invalid/d", "host no.such.host.invalid, port 5432"),
    ],
)
def test_a_database_that_cannot_be_used(server: Server, url, words):
    with pytest.raises(StorageError, match=words) as caught:
        open_storage(url(server))
    told = str(caught.value)
    assert "\n" not in told
    assert not any(secret in told for secret in (PASSWORD, "s3cret", "wr0ng", "pw@"))


def test_a_database_that_never_answers(monkeypatch):
    monkeypatch.setattr(storage, "_TIMEOUT", 2)
    with socket.create_server(("127.0.0.1", 0)) as mute:
        begun = time.monotonic()
        with pytest.raises(StorageError, match="timeout"):
            open_storage(f"postgresql://u:pw@127.0.0.1:{mute.getsockname()[1]}/d")
    assert time.monotonic() - begun < 6


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("sqlite:///study.db", "got sqlite://…; for one machine a file does"),
        ("mysql://u:pw@h/d", "got mysql://…"),
        ("postgresql://u:p:w@h:port/d", "the one given cannot be read"),
        ("postgresql://u:pw@h", "must name a database, got host h, port 5432, database none; add /NAME"),
    ],
)
def test_addresses_that_are_none(url, words):
    with pytest.raises(ValueError, match=words) as caught:
        open_storage(url)
    assert "pw" not in str(caught.value)


def test_files_that_are_no_journals(tmp_path):
    with pytest.raises(StorageError, match=f"cannot open the journal {tmp_path}: Is a directory"):
        open_storage(tmp_path)
    (tmp_path / "text").write_text("hello\nworld\n")
    with pytest.raises(StorageError, match="is not a journal of Optuna's, or it is damaged"):
        open_storage(tmp_path / "text")
    (tmp_path / "list").write_text("[1]\n[2]\n")
    with pytest.raises(StorageError, match="is not a journal"):
        open_storage(tmp_path / "list")
    with pytest.raises(StorageError, match="cannot open the journal"):
        open_storage(tmp_path / "text" / "journal")


@pytest.mark.parametrize("missing", ["psycopg", "sqlalchemy", "optuna"])
def test_without_the_extras(missing, monkeypatch):
    for name in [name for name in sys.modules if name.partition(".")[0] == missing]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(ImportError, match=r"pip install 'sympol\[tune"):
        open_storage(f"postgresql://u@127.0.0.1:{free_port()}/d")


@pytest.mark.parametrize("field", ["heartbeat", "retries"])
def test_numbers_that_make_no_sense(tmp_path, field):
    with pytest.raises(ValueError, match=f"{field} must be at least"):
        open_storage(tmp_path / "journal", **{field: -1})
