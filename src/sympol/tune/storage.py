"""The storage of a search's trials: a journal file, or PostgreSQL for many machines (docs/guides/cluster.md)."""

from __future__ import annotations

import contextlib
import re
import warnings
from collections.abc import Iterator
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from optuna.storages import BaseStorage
    from sqlalchemy.engine import URL

_TIMEOUT = 8
"""Seconds for a database to answer."""
_LOCK = 0x53796D706F6C
"""The number of our advisory lock in a database ('Sympol' in ASCII)."""


class StorageError(OSError):
    """A storage that cannot be opened; the message does not contain the password."""


def open_storage(url_or_path: str | PathLike[str], *, heartbeat: int = 30, retries: int = 2) -> BaseStorage:
    """Open the storage of an Optuna study, creating it if there is none.

    Args:
        url_or_path: A file (a journal, which processes of one machine or one shared file system can write together),
            or ``"postgresql://user:password@host:5432/database"``.
        heartbeat: PostgreSQL: seconds between signs of life of a trial. After three without one, its worker counts as
            dead and the trial is queued again. `optuna.Study.optimize` gives these signs, ask and tell do not.
        retries: PostgreSQL: how often a trial is queued again.

    Raises:
        StorageError: The storage does not answer, or refuses.
        ValueError: The address is neither a path nor PostgreSQL's.
        ImportError: Optuna or psycopg is not installed.
    """
    if heartbeat < 1:
        raise ValueError(f"heartbeat must be at least 1 second, got {heartbeat}")
    if retries < 0:
        raise ValueError(f"retries must be at least 0, got {retries}")
    try:
        import optuna
    except ImportError as error:
        raise ImportError(f"a search needs Optuna ({error}): pip install 'sympol[tune]'") from None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        scheme = re.match(r"([A-Za-z0-9+]+)://", text := str(url_or_path))
        if scheme is None:
            return _journal(Path(url_or_path))
        if re.fullmatch(r"postgres(ql)?(\+psycopg)?", scheme[1]) is None:
            raise ValueError(
                f"a storage must be a file's path or postgresql://user@host/database, got {scheme[1]}://…; "
                "for one machine a file does"
            )
        return _postgresql(_parsed(text), heartbeat, retries)


def _journal(path: Path) -> BaseStorage:
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # not the symbolic link Optuna locks with unless told: file systems mounted from Windows have none
        return JournalStorage(JournalFileBackend(str(path), JournalFileOpenLock(str(path))))
    except OSError as error:
        raise StorageError(
            f"cannot open the journal {path}: {error.strerror or error}; give a file in a folder you may write to"
        ) from None
    except (ValueError, KeyError, TypeError):  # not JSON, or JSON that is no journal
        raise StorageError(
            f"{path} is not a journal of Optuna's, or it is damaged; give another file, which will be made"
        ) from None


def _parsed(text: str) -> URL:
    try:
        from sqlalchemy.engine import make_url
        from sqlalchemy.exc import ArgumentError
    except ImportError as error:
        raise _missing(error) from None
    try:
        url = make_url(text).set(drivername="postgresql+psycopg")
    except (ArgumentError, ValueError):  # its message would show the password
        raise ValueError(
            "a PostgreSQL address must be postgresql://user:password@host:port/database, with the signs @ : / % # ? "
            "in user and password written as %40 %3A %2F %25 %23 %3F; the one given cannot be read"
        ) from None
    if not url.database:
        raise ValueError(
            f"a PostgreSQL address must name a database, got {_where(url)}; add /NAME to its end"
        )
    return url


def _postgresql(url: URL, heartbeat: int, retries: int) -> BaseStorage:
    from optuna.storages import RDBStorage, RetryHeartbeatStaleTrialCallback
    from sqlalchemy.pool import NullPool

    with _alone(url):
        return RDBStorage(
            url.render_as_string(hide_password=False),
            # no connection stays open between the few queries of a trial: a firewall would drop it, and a hundred
            # workers would use up a server's hundred connections
            engine_kwargs={"poolclass": NullPool, "connect_args": {"connect_timeout": _TIMEOUT}},
            heartbeat_interval=heartbeat,
            grace_period=3 * heartbeat,
            heartbeat_stale_trial_callback=RetryHeartbeatStaleTrialCallback(max_retry=retries),
        )


@contextlib.contextmanager
def _alone(url: URL) -> Iterator[None]:
    """Hold a lock in the database: workers that start together would make the same tables at the same time."""
    try:
        from sqlalchemy import create_engine, text
        from sqlalchemy.exc import SQLAlchemyError
        from sqlalchemy.pool import NullPool

        engine = create_engine(url, poolclass=NullPool, connect_args={"connect_timeout": _TIMEOUT})
    except ImportError as error:
        raise _missing(error) from None
    try:
        with engine.begin() as connection:
            connection.execute(text("SET LOCAL lock_timeout = '10s'"))
            connection.execute(text(f"SELECT pg_advisory_xact_lock({_LOCK})"))
            yield
    except SQLAlchemyError as error:
        raise StorageError(_message(url, error)) from None


def _message(url: URL, error: Any) -> str:
    reason = " ".join(str(getattr(error, "orig", None) or error).split())
    if url.password:
        reason = reason.replace(str(url.password), "***")
    return (
        f"PostgreSQL at {_where(url)} cannot be used: {reason}; is it running, does it listen on that address "
        "(listen_addresses, pg_hba.conf), does the database exist (createdb), are user and password right?"
    )


def _where(url: URL) -> str:
    host = url.host or url.query.get("host") or "localhost"
    return f"host {host}, port {url.port or 5432}, database {url.database or 'none'}"


def _missing(error: ImportError) -> ImportError:
    return ImportError(
        f"PostgreSQL needs SQLAlchemy and psycopg ({error}): pip install 'sympol[tune,cluster]', or give a file"
    )
