"""metrics.csv: read by its header, and nothing in it lost."""

from __future__ import annotations

import math
import random
import warnings
from pathlib import Path

import pytest

from sympol.runs.metrics import STEP, MetricsFile, SetAside

from ..tiny import COLUMNS

ROWS = [[float(step), *(step + i / 8 for i in range(1, len(COLUMNS)))] for step in range(100, 4000, 100)]
"""39 of them."""


def text(
    rows: list[list[float]], names: tuple[str, ...] = COLUMNS, separator: str = ",", end: str = "\r\n"
) -> str:
    lines = [separator.join(names)]
    for row in rows:
        values = dict(zip(COLUMNS, row, strict=True))
        lines.append(separator.join("x" if n == "note" else f"{values[n]:.6g}" for n in names))
    return "".join(line + end for line in lines)


def without(*missing: str) -> tuple[str, ...]:
    return tuple(name for name in COLUMNS if name not in missing)


@pytest.fixture
def file(tmp_path) -> Path:
    return tmp_path / "metrics.csv"


@pytest.mark.parametrize(
    "content",
    [
        text(ROWS),
        text(ROWS, end="\n"),
        "\ufeff" + text(ROWS),
        text(ROWS, (*COLUMNS, "note")),
        text(ROWS, ("note", *COLUMNS)),
        text(ROWS, COLUMNS[::-1]),
        text(ROWS, without("train/value_loss")),
        text(ROWS, (*without("train/entropy")[::-1], "note")),
        text(ROWS, separator=";"),
        text(ROWS, separator="\t"),
        text(ROWS, separator=";").replace(".", ","),
        "\r\n".join(f"{line.split(',')[0]}.0,{line.split(',', 1)[1]}" if line[0].isdigit() else line
                    for line in text(ROWS).split("\r\n") if line) + "\r\n",
        text(ROWS).replace("time/total_timesteps", '"time/total_timesteps"'),
        text(ROWS).replace(",", " , "),
    ],
    ids=["ours", "newlines", "mark", "extra", "first", "reversed", "missing", "all", "semicolons", "tabs",
         "decimal commas", "float steps", "quoted", "spaces"],
)  # fmt: skip
def test_no_row_is_lost_and_nothing_is_mislabelled(file, content):
    file.write_bytes(content.encode())
    metrics = MetricsFile(file)

    def check(rows: list[list[float]]) -> None:
        found = metrics.read()
        assert [row[STEP] for row in found] == [row[0] for row in rows]
        for row, known in zip(found, rows, strict=True):
            for name, value in zip(COLUMNS, known, strict=True):
                assert math.isnan(row[name]) or row[name] == pytest.approx(value, rel=1e-5), name

    check(ROWS)
    metrics.forget_after(3000)
    check(ROWS[:30])
    metrics.append(dict(zip(COLUMNS, [3100, *ROWS[30][1:]], strict=True)))
    check(ROWS[:31])
    missing = {name for name in COLUMNS if any(math.isnan(row[name]) for row in metrics.read())}
    assert missing == {name for name in COLUMNS if name not in content and f'"{name}"' not in content}
    assert ("note" in content) == (file.read_text().count("x") > 30)
    assert [path.name for path in file.parent.iterdir()] == ["metrics.csv"]


def test_our_own_file_stays_as_it_is_to_the_byte(file):
    file.write_bytes(text(ROWS).encode())
    before = file.stat().st_mtime_ns
    MetricsFile(file).forget_after(10_000)
    assert (file.read_bytes(), file.stat().st_mtime_ns) == (text(ROWS).encode(), before)
    MetricsFile(file).forget_after(3000)
    assert file.read_bytes() == text(ROWS[:30]).encode()


def test_what_cannot_be_read_is_kept_aside_and_said(file):
    lines = text(ROWS).split("\r\n")
    lines[3], lines[7], lines[9] = "300,1,2", lines[7].replace(",", ",much,", 1), "NaN" + lines[9][3:]
    bad = [lines[3], lines[7], lines[9]]
    file.write_bytes("\r\n".join(lines).encode() + b"\xff\xfe\r\n")
    bad.append("\xff\xfe")
    metrics = MetricsFile(file)
    with pytest.warns(SetAside, match=r"metrics.csv: 4 lines cannot be read"):
        assert len(metrics.read()) == 36
    with pytest.warns(SetAside, match=r"4 lines cannot be read and will be kept in metrics.unread.csv"):
        metrics.forget_after(10_000)
    assert len(metrics.read()) == 36
    assert file.with_name("metrics.unread.csv").read_bytes().decode("latin-1").splitlines() == bad


@pytest.mark.parametrize(
    "content",
    [
        b"1,2,3\r\n4,5,6\r\n",
        text(ROWS).split("\r\n", 1)[1].encode(),
        text(ROWS).replace(COLUMNS[1], COLUMNS[2], 1).encode(),
        text(ROWS).encode("utf-16"),
        random.Random(0).randbytes(1000),
    ],
    ids=["stranger", "no header", "one name twice", "utf-16", "noise"],
)
def test_a_file_without_our_header_is_kept_aside(file, content):
    file.write_bytes(content)
    with pytest.warns(SetAside, match=r"metrics\.unread\.csv"):
        MetricsFile(file).append(dict(zip(COLUMNS, [100, *ROWS[0][1:]], strict=True)))
    assert [row[STEP] for row in MetricsFile(file).read()] == [100]
    kept = file.with_name("metrics.unread.csv").read_bytes()
    assert kept.replace(b"\r", b"").strip(b"\n") == content.replace(b"\r", b"").strip(b"\n")


def test_what_is_kept_aside_replaces_nothing(file):
    for number in ("", "-2", "-3"):
        file.write_text(f"mine {number}\n")
        with pytest.warns(SetAside):
            MetricsFile(file).forget_after(0)
        assert file.with_name(f"metrics.unread{number}.csv").read_text() == f"mine {number}\n"
        assert not file.exists()


def test_rows_that_are_written_after_an_edit_have_the_right_names(file):
    """Somebody saves the file from a spreadsheet while the training goes on."""
    metrics = MetricsFile(file)
    row = dict(zip(COLUMNS, [100, *ROWS[0][1:]], strict=True))
    metrics.append(row)
    file.write_text(text(ROWS[:1], COLUMNS[::-1], separator=";"))
    metrics.append({**row, STEP: 200})
    assert metrics.read() == [pytest.approx(row, rel=1e-5), pytest.approx({**row, STEP: 200}, rel=1e-5)]


def test_mutated_files_never_raise_and_keep_every_line(file):
    dice, whole = random.Random(1), text(ROWS[:9]).encode()
    for _ in range(300):
        content = bytearray(whole)
        for _ in range(dice.randrange(1, 6)):
            at = dice.randrange(len(content))
            content[at : at + dice.randrange(3)] = dice.choice(
                [b"", b",", b"\n", b"\x00", b'"', b";", b"nan", b"\xff"]
            )
        file.write_bytes(content)
        for other in file.parent.glob("metrics.unread*"):
            other.unlink()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SetAside)
            metrics = MetricsFile(file)
            rows = metrics.read()
            metrics.forget_after(math.inf)
            again = metrics.read()
        assert len(again) - len(rows) in (0, 1)  # a last line that only lacks its end is kept
        aside = sum(len(other.read_bytes().split(b"\n")) - 1 for other in file.parent.glob("metrics.unread*"))
        lines = [line for line in content.replace(b"\r", b"").split(b"\n") if line.strip()]
        assert len(again) + aside >= len(lines) - 2  # but for the header and a torn last line
