"""Tables as files: Markdown, LaTeX, CSV and plots, made from records alone."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from .. import files
from ..results.formatting import count, latex, markdown
from ..results.statistics import Moments, mean_interval, training_means
from .comparisons import paired
from .grids import grids, not_run
from .record import Cell, Record
from .summary import CellSummary, by_cell, summarise
from .tables import SHORT, TABLES, Table, exists, is_tree, paper_number

UNITS = (
    "mean ± standard deviation over n trainings; a training is its mean undiscounted return over its test episodes, "
    "played deterministically on Gymnasium. Tests between methods are Welch's, α = 0.05, corrected by Holm for all "
    "comparisons of an environment; few trainings leave many differences undecided. Beside ours the paper's number."
)


def write(table: Table, records: Iterable[Record], out_dir: Path) -> list[Path]:
    """Write ``<name>.md``, ``.tex``, ``.csv`` and the plots of a table.

    Args:
        table: The table.
        records: Records, which may be of other tables, too.
        out_dir: The folder, created if it is missing.

    Returns:
        The paths of all files.

    Raises:
        RecordError: Two records are of one cell.
    """
    from .figures import write_figures  # matplotlib is slow to import

    found = by_cell(records)
    out_dir.mkdir(parents=True, exist_ok=True)
    plots = write_figures(table, found, out_dir)
    texts = {
        ".md": f"# {table.title}\n\n{section(table, found, [plot.name for plot in plots])}",
        ".tex": to_latex(table, found),
        ".csv": to_csv(table, found),
    }
    for suffix, text in texts.items():
        files.write(out_dir / f"{table.name}{suffix}", text)
    return [*(out_dir / f"{table.name}{suffix}" for suffix in texts), *plots]


def write_docs(
    records: Iterable[Record], docs_dir: Path, tables: Iterable[Table] = tuple(TABLES.values())
) -> list[Path]:
    """Write ``tables.md`` with all tables one after another, and the plots to ``images/tables``.

    Args:
        records: All records.
        docs_dir: The folder of the documentation.
        tables: The tables.

    Returns:
        The paths of all files, the page first.
    """
    from .figures import write_figures

    found, tables = by_cell(records), [*tables]
    images = docs_dir / "images" / "tables"
    parts = [
        "# Tables",
        "Written by `sympol bench` from its records; nothing here is typed by hand.",
        f"Unless a table says otherwise: {UNITS}",
        f"All together: {provenance(found.values())}",
        "\n".join(f"- [{table.title}](#{table.name}){_done(table, found)}" for table in tables),
    ]
    written = []
    for table in tables:
        plots = write_figures(table, found, images)
        written += plots
        inside = [plot.relative_to(docs_dir).as_posix() for plot in plots]
        parts.append(
            f'<a id="{table.name}"></a>\n\n## {table.title}\n\n{section(table, found, inside).rstrip()}'
        )
    page = docs_dir / "tables.md"
    files.write(page, "\n\n".join(parts) + "\n")
    return [page, *written]


def section(table: Table, records: Mapping[Cell, Record], images: Iterable[str] = ()) -> str:
    """Return a table in Markdown: its grids and plots, their provenance, and the cells that were not run.

    Args:
        table: The table.
        records: The records by cell.
        images: Paths of its plots, relative to the page.
    """
    parts = [markdown(grid) for grid in grids(table, records)]
    parts += [
        f"![{table.title}: {Path(image).stem.removeprefix(table.name + '-')}]({image})" for image in images
    ]
    parts.append(provenance(records[cell] for cell in table.cells() if cell in records))
    if missing := not_run(table, records):
        names = (f"{cell.environment} {'-'.join(filter(None, cell[1:]))}" for cell in missing)
        parts.append(f"Not run ({len(missing)} of {len(table.cells())} cells): {', '.join(names)}.")
    return "\n\n".join(parts) + "\n"


def to_latex(table: Table, records: Mapping[Cell, Record]) -> str:
    """Return a table in LaTeX, with the paper's abbreviations of environments."""
    return latex(grids(table, records), name=table.name, title=table.title, note=UNITS, abbreviations=SHORT)


def provenance(records: Iterable[Record]) -> str:
    """Return one line with the trainings, seeds, commits and dates of some records; ranges where they differ."""
    records = list(records)
    if not records:
        return "Nothing of it has been run yet."
    seeds = sorted({seed for record in records for seed in record.seeds})
    days = sorted({record.date[:10] for record in records if record.date})
    commits = sorted({record.commit[:10] for record in records if record.commit})
    facts = [
        f"{_range(len(record.seeds) for record in records)} trainings (seeds {_seeds(seeds)})",
        f"{_range(len(record.returns[0]) for record in records)} test episodes each",
        f"{' or '.join(map(count, sorted({record.total_timesteps for record in records})))} environment steps",
        f"measured {days[0]}{f' to {days[-1]}' if len(days) > 1 else ''}" if days else "",
        f"commit{'s' if len(commits) > 1 else ''} {', '.join(commits)}" if commits else "",
    ]
    return "; ".join(filter(None, facts)) + "."


def to_csv(table: Table, records: Mapping[Cell, Record]) -> str:
    """Return CSV with a line for each cell and all its statistics; a column that was not measured is empty."""
    summaries = summarise(table, records)
    lines = [_line(table, cell, summaries.get(cell)) for cell in table.cells()]
    out = io.StringIO()
    writer = csv.DictWriter(out, list(_line(table, Cell("", "", ""), None)), lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    return out.getvalue()


def _line(table: Table, cell: Cell, of: CellSummary | None) -> dict[str, Any]:
    record = of.record if of else None
    bounds = mean_interval(training_means(record.returns)) if record else None
    line: dict[str, Any] = {"table": table.name, **cell._asdict()}
    line["status"] = ("run" if of else "not run") if exists(cell) else "impossible"
    line |= {
        "trainings": record and len(record.seeds),
        "episodes": record and len(record.returns[0]),
        "total_timesteps": record and record.total_timesteps,
        "is_tree": record and is_tree(record),
    }
    line |= _moments("return", of and of.test)
    line |= {"return_low": bounds and bounds.low, "return_high": bounds and bounds.high}
    line["is_among_best"] = of.is_among_best if of and of.best else None
    for name, comparison in (
        ("p_best_welch_holm", of and of.best),
        ("p_best_permutation_holm", of and of.best_by_permutation),
        ("p_first_row_welch_holm", of and of.first),
    ):
        line[name] = comparison and comparison.p
    for name in ("validation", "sampled", "nodes", "seconds"):
        line |= _moments(name, getattr(of, name, None))
    line["p_validation_test_paired"] = _paired_p(record)
    for name, loss in (("d", of and of.loss), ("d_bootstrap", of and of.loss_by_bootstrap)):
        line |= {f"{name}{end}": loss and loss[i] for i, end in enumerate(("", "_low", "_high"))}
    for quantity in ("return", "validation", "cohens_d", "nodes", "seconds"):
        line[f"paper_{quantity}"] = paper_number(quantity, cell)
    line["seeds"] = record and " ".join(map(str, record.seeds))
    line |= {"date": record and record.date, "commit": record and record.commit}
    return line


def _paired_p(record: Record | None) -> float | None:
    if record is None or record.validation_returns is None:
        return None
    return paired(training_means(record.validation_returns), training_means(record.returns))


def _moments(name: str, of: Moments | None) -> dict[str, float | None]:
    return {f"{name}_mean": of.mean if of else None, f"{name}_std": of.std if of else None}


def _done(table: Table, records: Mapping[Cell, Record]) -> str:
    cells = table.cells()
    return f": {sum(cell in records for cell in cells)} of {len(cells)} cells"


def _range(numbers: Iterable[int]) -> str:
    every = sorted({*numbers})
    return str(every[0]) if len(every) == 1 else f"{every[0]} to {every[-1]}"


def _seeds(seeds: list[int]) -> str:
    whole = len(seeds) > 2 and seeds == list(range(seeds[0], seeds[-1] + 1))
    return f"{seeds[0]} to {seeds[-1]}" if whole else ", ".join(map(str, seeds))
