"""The metrics of a training: a CSV file with one row per validation, and TensorBoard.

The names are stable-baselines3's. Nothing here knows which metrics there are: a column is a metric if its name has a
slash, such as ``train/value_loss``, and a new metric is a new column.
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

STEP = "time/total_timesteps"
"""The column that orders the rows: environment steps so far."""
_SEPARATORS = (",", ";", "\t", "|", " ")
_NEWLINE = "\r\n"
_LONGEST_HEADER = 100_000


class SetAside(UserWarning):
    """Lines of a `metrics.csv` that cannot be read were moved to another file."""


class MetricsRow(dict[str, float]):
    """One row by metric; a metric that the row does not have is NaN."""

    def __missing__(self, name: str) -> float:
        """Return NaN."""
        return math.nan


class MetricsFile:
    """A CSV file with one row per validation; each row is in the file when `append` returns.

    It is read by the names in its header, so that a file that was edited, or saved by a spreadsheet, is understood:
    columns may be missing, added or in another order, and values separated by semicolons or tabs.

    Args:
        path: The file; it need not exist.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def append(self, metrics: Mapping[str, float]) -> None:
        """Write one row.

        Args:
            metrics: Values by name, `STEP` among them. Names that the file does not have yet become new columns.

        Raises:
            OSError: The file cannot be written.
        """
        header, ends_with_line = self._ends()
        if header and not metrics.keys() <= set(header):
            self._rewrite(math.inf, more=metrics)
            header, ends_with_line = self._ends()
        texts = {name: str(value) if name == STEP else f"{value:.6g}" for name, value in metrics.items()}
        names = header or list(metrics)
        lines = [*([] if header else [names]), [texts.get(name, "") for name in names]]
        files.append(self._path, ("" if ends_with_line else _NEWLINE) + "".join(map(_line, lines)))

    def read(self) -> list[MetricsRow]:
        """Return all rows but one that a kill cut short. Lines that cannot be read are left out, with a warning.

        Raises:
            ValueError: The file cannot be read.
        """
        try:
            table = _Table.of(self._content())
        except (OSError, ValueError) as error:
            raise ValueError(f"{self._path} cannot be read: {error}") from error
        if table.unread:
            warnings.warn(f"{self._path}: {_count(table.unread)} cannot be read", SetAside, stacklevel=2)
        return [row.values for row in table.rows]

    def forget_after(self, timestep: float) -> None:
        """Drop the rows after a checkpoint that training resumes from.

        Lines that cannot be read are moved to a file beside this one, with a warning that names it.

        Args:
            timestep: The timestep of the checkpoint.

        Raises:
            OSError: The file cannot be written.
        """
        self._rewrite(timestep)

    def _rewrite(self, timestep: float, more: Iterable[str] = ()) -> None:
        """Write the rows up to a timestep, with more columns."""
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
        new = "".join(table.lines(kept, more)).encode(errors="surrogateescape")
        if new != content:
            files.write(self._path, new)

    def _content(self) -> bytes:
        try:
            return files.read_bytes(self._path, files.MOST)
        except FileNotFoundError:
            return b""

    def _ends(self) -> tuple[list[str], bool]:
        """Return the names in the header if commas separate them, and whether the last line is complete."""
        if not self._path.exists() or not self._path.stat().st_size:
            return [], True
        with open(self._path, "rb") as file:
            header = file.readline(_LONGEST_HEADER).decode(errors="replace")
            file.seek(-1, os.SEEK_END)
            return _cells(header.strip(), ",") or [""], file.read(1) == b"\n"

    def _free_name(self) -> Path:
        """Return the name of a file beside this one that does not exist yet."""
        names = (f"{self._path.stem}.unread{f'-{n}' if n > 1 else ''}.csv" for n in itertools.count(1))
        return next(path for name in names if not os.path.lexists(path := self._path.with_name(name)))

    def _warn(self, message: str) -> None:
        warnings.warn(f"{self._path}: {message}", SetAside, stacklevel=4)


class _Row(NamedTuple):
    """One line: its text, its cells by column with decimal points, and its metrics."""

    text: str
    cells: Mapping[str, str]
    values: MetricsRow


class _Table(NamedTuple):
    """What a file holds.

    Attributes:
        header: The names of the columns.
        has_commas: Whether commas separate the values.
        rows: The lines that can be read.
        torn: The last line, where it can be read but does not end: a kill may have cut its last number short.
        unread: The lines that cannot be read; all of them where the header cannot.
    """

    header: list[str]
    has_commas: bool
    rows: list[_Row]
    torn: _Row | None
    unread: list[str]

    @classmethod
    def of(cls, content: bytes) -> _Table:
        text = content.decode("utf-8-sig", "surrogateescape")
        *lines, last = (line.rstrip("\r") for line in text.split("\n"))
        header, separator = _header(next((line for line in [*lines, last] if line.strip()), ""))
        if not header:
            is_begun = not lines and STEP.startswith(last)  # a kill cut the first line short
            return cls([], False, [], None, [] if is_begun else [line for line in [*lines, last] if line])
        read = [(line, _row(line, header, separator)) for line in lines if line.strip()][1:]
        return cls(
            header,
            separator == ",",
            [row for _, row in read if row is not None],
            _row(last, header, separator) if lines else None,
            [line for line, row in read if row is None],
        )

    def lines(self, rows: Iterable[_Row], more: Iterable[str]) -> Iterator[str]:
        """Yield a file with these rows, as they were written where neither columns nor separators change."""
        names = [*self.header, *(name for name in more if name not in self.header)]
        yield _line(names)
        for row in rows:
            if self.has_commas and len(names) == len(self.header):
                yield f"{row.text}{_NEWLINE}"
                continue
            step = row.values[STEP]
            cells = {**row.cells, STEP: str(int(step)) if step.is_integer() else repr(step)}
            yield _line([cells.get(name, "") for name in names])


def _header(line: str) -> tuple[list[str], str]:
    """Return the names in a first line and what separates them; no names where it does not tell the columns apart."""
    for separator in _SEPARATORS:
        names = _cells(line, separator)
        if STEP in names and len(set(names)) == len(names):
            return names, separator
    return [], ","


def _row(line: str, header: list[str], separator: str) -> _Row | None:
    """Return a row; None for fewer or more values than the header has names, or a metric that is not a number."""
    texts = _cells(line, separator)
    if len(texts) < len(header) or any(texts[len(header) :]):
        return None
    cells = dict(zip(header, texts, strict=False))
    metrics = [name for name in header if "/" in name]
    if separator != ",":  # where numbers have a decimal comma, values are separated by something else
        cells |= {name: cells[name].replace(",", ".") for name in metrics}
    try:
        values = MetricsRow({name: float(cells[name] or math.nan) for name in metrics})
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
    """The same numbers as TensorBoard scalars.

    Args:
        folder: Where the event file is written.

    Raises:
        ImportError: tensorboardX is not installed.
    """

    def __init__(self, folder: Path) -> None:
        self._writer: Any = self.require()(str(folder))

    @staticmethod
    def require() -> Any:
        """Return the class of the writer.

        Raises:
            ImportError: tensorboardX is not installed.
        """
        try:
            from tensorboardX import SummaryWriter
        except ImportError as error:
            raise ImportError(
                "TensorBoard logs need tensorboardX: pip install 'sympol[tensorboard]'"
            ) from error
        return SummaryWriter

    def append(self, metrics: Mapping[str, float]) -> None:
        """Write one point of every curve."""
        for name, value in metrics.items():
            if name != STEP:
                self._writer.add_scalar(name, value, int(metrics[STEP]))
        self._writer.flush()

    def close(self) -> None:
        """Write what is left, and close the file."""
        self._writer.close()
