"""What happened during training, a row a validation: a CSV file, and TensorBoard where it is asked for.

The names are stable-baselines3's.
"""

from __future__ import annotations

import csv
import io
import itertools
import math
import os
import warnings
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from .. import files

COLUMNS = (
    "time/total_timesteps",
    "time/time_elapsed",
    "time/fps",
    "rollout/ep_rew_mean",
    "rollout/ep_len_mean",
    "eval/mean_reward",
    "train/policy_gradient_loss",
    "train/value_loss",
    "train/entropy",
    "train/approx_kl",
    "train/clip_fraction",
)
STEP = COLUMNS[0]
_SEPARATORS = (",", ";", "\t", "|", " ")
_NEWLINE = "\r\n"
_LONGEST_HEADER = 100_000


class SetAside(UserWarning):
    """Lines of a `metrics.csv` that cannot be read, and the file that they are kept in."""


class MetricsFile:
    """A CSV of one row a validation; every row is in the file when `append` returns.

    It is read by the names in its header, so that a file that was edited, or saved by a spreadsheet, is understood:
    columns may be missing, added or in another order, values separated by semicolons or tabs.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def append(self, metrics: Mapping[str, float]) -> None:
        """Write one row.

        Raises:
            OSError: it cannot be written.
        """
        row = [f"{metrics[name]:.6g}" if name != STEP else str(metrics[name]) for name in COLUMNS]
        header, ends_with_line = self._ends()
        if header and header[: len(COLUMNS)] != [*COLUMNS]:
            self.forget_after(math.inf)  # somebody else has rewritten it; from here on its columns are ours
            header, ends_with_line = self._ends()
        lines = [row + [""] * (len(header) - len(COLUMNS))] if header else [[*COLUMNS], row]
        files.append(self._path, ("" if ends_with_line else _NEWLINE) + "".join(map(_line, lines)))

    def read(self) -> list[dict[str, float]]:
        """All rows but one that a kill cut short; what a row lacks is NaN.

        Lines that cannot be read are left out, with a warning.

        Raises:
            ValueError: the file cannot be read.
        """
        try:
            table = _Table.of(self._content())
        except (OSError, ValueError) as error:
            raise ValueError(f"{self._path} cannot be read: {error}") from error
        if table.unread:
            warnings.warn(f"{self._path}: {_count(table.unread)} cannot be read", SetAside, stacklevel=2)
        return [row.values for row in table.rows]

    def forget_after(self, timestep: float) -> None:
        """Drop the rows beyond a checkpoint that training resumes from, and write the others in our columns.

        Lines that cannot be read are moved to a file beside it, with a warning that names it.

        Raises:
            OSError: it cannot be written.
        """
        try:
            content = self._content()
        except ValueError as error:
            aside = self._free_name()
            os.replace(self._path, aside)
            self._warn(f"it cannot be read ({error}) and is now {aside.name}")
            return
        table = _Table.of(content)
        if table.unread:
            aside = self._free_name()
            files.write(aside, "".join(f"{line}\n" for line in table.unread).encode(errors="surrogateescape"))
            self._warn(f"{_count(table.unread)} cannot be read and will be kept in {aside.name}")
        rows = [*table.rows, *([table.torn] if table.torn is not None else [])]
        kept = [row for row in rows if row.values[STEP] <= timestep]
        if not kept:
            self._path.unlink(missing_ok=True)
            return
        new = "".join(table.lines(kept)).encode(errors="surrogateescape")
        if new != content:
            files.write(self._path, new)

    def _content(self) -> bytes:
        try:
            return files.read_bytes(self._path, files.MOST)
        except FileNotFoundError:
            return b""

    def _ends(self) -> tuple[list[str], bool]:
        """The names in the header, and whether the last line is complete."""
        if not self._path.exists() or not self._path.stat().st_size:
            return [], True
        with open(self._path, "rb") as file:
            header = file.readline(_LONGEST_HEADER).decode(errors="replace")
            file.seek(-1, os.SEEK_END)
            return _cells(header.strip(), ",") or [""], file.read(1) == b"\n"

    def _free_name(self) -> Path:
        """Of a file beside it that is not there yet."""
        names = (f"{self._path.stem}.unread{f'-{n}' if n > 1 else ''}.csv" for n in itertools.count(1))
        return next(path for name in names if not os.path.lexists(path := self._path.with_name(name)))

    def _warn(self, words: str) -> None:
        warnings.warn(f"{self._path}: {words}", SetAside, stacklevel=3)


class _Row(NamedTuple):
    text: str
    cells: Mapping[str, str]
    """By the names in the header; numbers with a decimal point."""
    values: dict[str, float]
    """Of all `COLUMNS`."""


class _Table(NamedTuple):
    """What a file holds."""

    header: list[str]
    is_ours: bool
    """Whether its first columns are `COLUMNS`, separated by commas."""
    rows: list[_Row]
    torn: _Row | None
    """The last line, where it can be read but does not end: a kill may have cut its last number short."""
    unread: list[str]
    """Lines that cannot be read; where the header cannot, all of them."""

    @classmethod
    def of(cls, content: bytes) -> _Table:
        text = content.decode("utf-8-sig", "surrogateescape")
        *lines, last = (line.rstrip("\r") for line in text.split("\n"))
        header, separator = _header(next((line for line in [*lines, last] if line.strip()), ""))
        if not header:
            is_begun = ",".join(COLUMNS).startswith(text.strip())  # a kill cut the first line short
            return cls([], False, [], None, [] if is_begun else [line for line in [*lines, last] if line])
        found = [(line, _row(line, header, separator)) for line in lines if line.strip()][1:]
        return cls(
            header,
            separator == "," and header[: len(COLUMNS)] == [*COLUMNS],
            [row for _, row in found if row is not None],
            _row(last, header, separator) if lines else None,
            [line for line, row in found if row is None],
        )

    def lines(self, rows: Iterable[_Row]) -> Iterator[str]:
        """The file that has these rows: as they were written, or in our columns and then those that others added."""
        if self.is_ours:
            yield _line(self.header)
            yield from (f"{row.text}{_NEWLINE}" for row in rows)
            return
        names = [*COLUMNS, *(name for name in self.header if name not in COLUMNS)]
        yield _line(names)
        for row in rows:
            step = row.values[STEP]
            cells = {**row.cells, STEP: str(int(step)) if step.is_integer() else repr(step)}
            yield _line([cells.get(name) or ("nan" if name in COLUMNS else "") for name in names])


def _header(line: str) -> tuple[list[str], str]:
    """The names in a first line and what separates them; nothing where it does not tell the columns apart."""
    for separator in _SEPARATORS:
        names = _cells(line, separator)
        if STEP in names and len(set(names)) == len(names):
            return names, separator
    return [], ","


def _row(line: str, header: list[str], separator: str) -> _Row | None:
    """A row; None where it has fewer values than the header names, more of them, or one that is no number."""
    texts = _cells(line, separator)
    if len(texts) < len(header) or any(texts[len(header) :]):
        return None
    cells = dict(zip(header, texts, strict=False))
    if separator != ",":  # where numbers have a decimal comma, values are separated by something else
        cells |= {name: text.replace(",", ".") for name, text in cells.items() if name in COLUMNS}
    try:
        values = {name: float(cells.get(name) or math.nan) for name in COLUMNS}
    except ValueError:
        return None
    return _Row(line, cells, values) if 0 <= values[STEP] < math.inf else None


def _cells(line: str, separator: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]
    except csv.Error:
        return []


def _line(cells: Iterable[str]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator=_NEWLINE).writerow(cells)
    return text.getvalue()


def _count(lines: list[str]) -> str:
    return f"{len(lines):,} line{'s' if len(lines) != 1 else ''}"


class TensorBoard:
    """The same numbers as TensorBoard scalars."""

    def __init__(self, folder: Path) -> None:
        self._writer: Any = self.require()(str(folder))

    @staticmethod
    def require() -> Any:
        """The writer's class. Raises ImportError where it is not installed."""
        try:
            from tensorboardX import SummaryWriter
        except ImportError as error:
            raise ImportError(
                "TensorBoard logs need tensorboardX: pip install 'sympol[tensorboard]'"
            ) from error
        return SummaryWriter

    def append(self, metrics: Mapping[str, float]) -> None:
        """Write one point of every curve."""
        step = int(metrics[STEP])
        for name in COLUMNS[1:]:
            self._writer.add_scalar(name, metrics[name], step)
        self._writer.flush()

    def close(self) -> None:
        """Flush and close."""
        self._writer.close()
