"""A PostgreSQL server of the tests' own: the distribution's, in a temporary folder, on a free port of loopback."""

from __future__ import annotations

import os
import pwd
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

PASSWORD = "s3cret/w@rd"
INSTALL = Path(__file__).parents[1] / "install-tools.sh"


@dataclass(frozen=True)
class Server:
    port: int

    def url(self, database: str = "postgres", *, password: str = PASSWORD, port: int | None = None) -> str:
        quoted = password.replace("/", "%2F").replace("@", "%40")
        return f"postgresql://sympol:{quoted}@127.0.0.1:{port or self.port}/{database}"


@pytest.fixture(scope="session")
def server() -> Iterator[Server]:
    """Started as another user where we are root, whom PostgreSQL refuses to serve."""
    programs = _programs()
    folder = Path(tempfile.mkdtemp(prefix="sympol-postgres-"))  # pytest's own are closed to other users
    data, secret = folder / "data", folder / "password"
    secret.write_text(PASSWORD)
    as_other: list[str] = []
    if os.getuid() == 0:
        user = _other_user()
        for path in (folder, secret):
            os.chown(path, user.pw_uid, user.pw_gid)
        as_other = ["setpriv", f"--reuid={user.pw_uid}", f"--regid={user.pw_gid}", "--clear-groups"]
    initdb = [programs / "initdb", "-D", data, "-U", "sympol", "--auth=scram-sha-256", f"--pwfile={secret}"]
    _run([*as_other, *initdb, "--no-sync", "--no-locale", "--encoding=UTF8"], folder)
    port = free_port()
    options = f"-p {port} -k {folder} -c listen_addresses=127.0.0.1 -c fsync=off"
    pg_ctl = [*as_other, programs / "pg_ctl", "-D", data, "-l", folder / "log"]
    try:
        _run([*pg_ctl, "-o", options, "-w", "start"], folder)
        yield Server(port)
    finally:
        subprocess.run([*pg_ctl, "-m", "immediate", "stop"], capture_output=True, cwd=folder, check=False)
        shutil.rmtree(folder, ignore_errors=True)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def _programs() -> Path:
    """Where initdb and pg_ctl are; without them root (as CI is) installs or fails, anybody else skips."""
    may_install = os.getuid() == 0
    if _found() is None and may_install:
        subprocess.run([INSTALL], check=True, timeout=300)
    found = _found()
    if found is not None:
        return found
    words = "no PostgreSQL server on this machine; install the distribution's package postgresql"
    if may_install or os.environ.get("CI"):
        pytest.fail(words)
    pytest.skip(words)


def _found() -> Path | None:
    installed = sorted(Path("/usr/lib/postgresql").glob("*/bin"), key=lambda path: path.parent.name)
    on_path = shutil.which("initdb")
    places = [*reversed(installed), *([Path(on_path).resolve().parent] if on_path else [])]
    return next((at for at in places if (at / "initdb").exists() and (at / "pg_ctl").exists()), None)


def _other_user() -> pwd.struct_passwd:
    try:
        return pwd.getpwnam("postgres")
    except KeyError:
        return pwd.getpwnam("nobody")


def _run(command: list[str | Path], folder: Path) -> None:
    # pg_ctl's server keeps what pg_ctl inherits: a pipe would never end, so into a file
    with (folder / "output").open("w+") as output:
        done = subprocess.run(command, stdout=output, stderr=output, cwd=folder, check=False, timeout=60)
        output.seek(0)
        assert done.returncode == 0, output.read()
