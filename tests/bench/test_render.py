"""What tables say of records, to the letter."""

from __future__ import annotations

import csv
import dataclasses
import io
import re

import numpy as np
import pytest

from sympol.bench.grids import grids
from sympol.bench.record import Cell, RecordError
from sympol.bench.render import provenance, section, to_csv, to_latex, write, write_docs
from sympol.bench.summary import by_cell
from sympol.bench.tables import TABLES, Row, Table
from sympol.results.formatting import count, in_latex, in_markdown, interval, number
from sympol.results.statistics import Interval

from .synthetic import record, records

ENVIRONMENTS = ("CartPole-v1", "Pendulum-v1")


def cut(name: str, *methods: str) -> Table:
    """A table of two environments, and of some methods."""
    table = TABLES[name]
    rows = tuple(row for row in table.rows if row.method in methods) if methods else table.rows
    return dataclasses.replace(table, environments=ENVIRONMENTS, rows=rows)


def fixed(environment: str, method: str, *means: float, **fields):
    """A record of trainings whose two episodes have these means."""
    returns = [[mean - 1, mean + 1] for mean in means]
    return record(
        Cell(environment, fields.pop("algo", "ppo"), method, fields.pop("variant", "")),
        trainings=len(means),
        **{"returns": returns, "validation_returns": returns} | fields,
    )


def text_of(table: Table, *found) -> str:
    return section(table, by_cell(found))


def test_a_table_of_returns():
    table = cut("viper-control", "tree", "sa-dt-5", "viper-5", "mlp")
    text = text_of(
        table,
        fixed("CartPole-v1", "tree", 499, 499, 499),
        fixed("CartPole-v1", "sa-dt-5", 440, 450, 430),
        fixed("CartPole-v1", "mlp", 499, 499, 499),
        fixed("Pendulum-v1", "tree", -1300, -1200, total_timesteps=100_000),
        fixed("Pendulum-v1", "mlp", -190),
    )
    assert text.splitlines()[:8] == [
        "|  | CartPole-v1 | Pendulum-v1 |",
        "| --- | ---: | ---: |",
        "| SYMPOL | **499.0 ± 0.0**<br>n=3; paper 500 | −1,250.0 ± 70.7<br>n=2; 100,000 steps; paper −323 |",
        "| SA-DT (d=5) | 440.0 ± 10.0<br>n=3; paper 446 | not run<br>paper −1,251 |",
        "| VIPER (d=5) | not run<br>paper 457 | — |",
        "| MLP | 499.0 ± 0.0<br>n=3; paper 500 | −190.0<br>n=1; paper −191 |",
        "",
        f"{table.caption} —: the method is for discrete actions.",
    ]
    assert "Not run (2 of 7 cells): Pendulum-v1 ppo-sa-dt-5, CartPole-v1 ppo-viper-5." in text
    assert "1 to 3 trainings (seeds 0 to 2); 2 test episodes each; 100 k or 1 M environment steps" in text


def test_only_whole_rows_are_averaged():
    table = cut("control-ppo", "tree", "sa-dt-5")
    found = [fixed(env, "tree", 10, 11, 12) for env in ENVIRONMENTS] + [
        fixed("CartPole-v1", "sa-dt-5", 1, 2, 3)
    ]
    _, overall = grids(table, by_cell(found))
    assert [entry.text for entry in overall.rows[1][1]] == ["not run", "not run"]
    assert re.fullmatch(r"1\.00 \[0\.\d\d, 1\.\d\d\]", overall.rows[0][1][0].text)


def test_where_no_environment_counts_there_is_no_mean():
    """The paper's mean runtime leaves LunarLander out."""
    for environments, columns in (
        (("LunarLander-v3",), ("LunarLander-v3",)),
        (("CartPole-v1", "LunarLander-v3"), ("CartPole-v1", "LunarLander-v3", "mean without LunarLander-v3")),
    ):
        table = dataclasses.replace(TABLES["runtime"], environments=environments)
        assert grids(table, {})[0].columns == columns


def test_nothing_run_is_said_not_estimated():
    for table in TABLES.values():
        text = section(table, {})
        assert "Nothing of it has been run yet." in text
        assert not re.search(r"n=\d", text)
        assert "±" not in text
        assert {row["status"] for row in csv.DictReader(io.StringIO(to_csv(table, {})))} == {"not run"}


def test_algorithms_are_compared_within_a_method():
    table = cut("ppo-vs-a2c", "tree", "mlp")
    found = [
        fixed("CartPole-v1", "tree", 100, 101, 102),
        fixed("CartPole-v1", "tree", 1, 2, 3, algo="a2c"),
        fixed("CartPole-v1", "mlp", 400, 401, 402),
        fixed("CartPole-v1", "mlp", 400, 401, 403, algo="a2c"),
    ]
    rows = dict(grids(table, by_cell(found))[0].rows)
    assert {name: entries[0].bold for name, entries in rows.items()} == {
        "MLP, PPO": True, "MLP, A2C": True, "SYMPOL, PPO": True, "SYMPOL, A2C": False,
    }  # fmt: skip


def test_ablations_say_better_and_worse():
    table = dataclasses.replace(cut("ablation"), rows=TABLES["ablation"].rows[:3])
    found = [fixed("CartPole-v1", "tree-paper", 100, 101, 102),
             fixed("CartPole-v1", "tree-paper", 1, 2, 3, variant="tree-critic"),
             fixed("CartPole-v1", "tree-paper", 200, 201, 202, variant="static-rollout")]  # fmt: skip
    rows = dict(grids(table, by_cell(found))[0].rows)
    assert rows["SYMPOL, paper's settings"][0][::2] == ("101.0 ± 1.0", False)
    assert rows["w/o separate architecture"][0][::2] == ("2.0 ± 1.0 ▼", False)
    assert rows["w/o dynamic rollout"][0][::2] == ("201.0 ± 1.0 ▲", True)


def test_information_that_is_lost():
    table = cut("information-loss", "tree", "d-sdt")
    same, kept = [[500.0, 500.0]] * 5, [[500.0, 500.0]] * 4 + [[230.0, 230.0]]
    found = [fixed("CartPole-v1", "tree", *[0.0] * 5, returns=same, validation_returns=same),
             fixed("CartPole-v1", "d-sdt", *[0.0] * 5, returns=kept, validation_returns=same),
             fixed("Pendulum-v1", "d-sdt", 1, 2, 3, validation_returns=[[90.0, 91.0]] * 3)]  # fmt: skip
    before, d = grids(table, by_cell(found))
    assert before.rows[0][1][0].text == "500.0 ± 0.0 → 500.0 ± 0.0"
    assert before.rows[1][1][0].text == "500.0 ± 0.0 → 446.0 ± 120.7"
    assert [entry.text for entry in d.rows[0][1]] == ["0.00 [0.00, 0.00]", "not run", "not run"]
    assert d.rows[1][1][0].text.startswith("0.63 [−0.6")
    assert [entry.bold for entry in d.rows[1][1]] == [False, True, True]
    assert d.columns[-1] == "mean"


def test_sizes_and_seconds():
    sizes = grids(
        cut("tree-size", "tree"), by_cell([fixed(env, "tree", 1, 2, nodes=(3, 5)) for env in ENVIRONMENTS])
    )
    assert [entry.text for entry in sizes[0].rows[0][1]] == ["4.0 ± 1.4", "4.0 ± 1.4", "4.0"]
    cells = [
        (env, method, s)
        for env in ENVIRONMENTS
        for method, s in (("tree-paper", (2, 3)), ("mlp-paper", (2, 2)))
    ]
    found = [fixed(env, method, 1, 2, seconds=s, variant="runtime") for env, method, s in cells]
    times, ratios = grids(cut("runtime", "tree-paper", "mlp-paper"), by_cell(found))
    assert [entry.text for entry in times.rows[0][1]] == ["2.5 ± 0.7", "2.5 ± 0.7", "2.5"]
    assert ratios.rows[0][1][0].text == "1.25 [1.00, 1.50]"
    [unknown] = grids(cut("tree-size", "tree"), by_cell([fixed("CartPole-v1", "tree", 1, nodes=None)]))
    assert [entry.text for entry in unknown.rows[0][1]] == ["not measured", "not run", "not run"]


def test_csv_has_a_line_for_each_cell_and_every_statistic():
    table = cut("viper-control", "tree", "sa-dt-5", "viper-5", "mlp")
    found = by_cell([record(cell) for cell in table.cells() if cell.environment == "CartPole-v1"])
    rows = [*csv.DictReader(io.StringIO(to_csv(table, found)))]
    assert len(rows) == len(table.cells()) == 7
    tree = next(row for row in rows if (row["environment"], row["method"]) == ("CartPole-v1", "tree"))
    assert (tree["status"], tree["is_among_best"], tree["return_mean"], tree["d"]) == (
        "run",
        "True",
        "500.0",
        "0.0",
    )
    other = next(row for row in rows if (row["environment"], row["method"]) == ("CartPole-v1", "sa-dt-5"))
    assert 0 < float(other["p_best_welch_holm"]) < 0.05
    means = np.mean(found[Cell("CartPole-v1", "ppo", "sa-dt-5")].returns, axis=1)
    assert float(other["return_std"]) == pytest.approx(means.std(ddof=1))
    assert next(row for row in rows if row["status"] == "not run")["return_mean"] == ""


def test_anybody_s_names_are_shown_and_break_nothing(tmp_path):
    cell = Cell("my/Maze_50-v0", "ppo", "mine_2")
    table = TABLES["control-ppo"].with_(environments=[cell.environment], methods=[cell.method])
    written = write(table, [record(cell)], tmp_path)
    assert {path.suffix for path in written} >= {".md", ".tex", ".csv"}
    assert r"my/Maze\_50-v0" in (tmp_path / "control-ppo.md").read_text()
    assert r"mine\_2 & not run & " in (tmp_path / "control-ppo.tex").read_text()
    for kind in ("information-loss", "tree-size", "runtime", "training-curves", "ablation", "ppo-vs-a2c"):
        odd = TABLES[kind].with_(environments=[cell.environment], methods=[cell.method])
        assert r"mine\_2" in section(odd, by_cell([record(cell, nodes=(3,) * 5)]))


def test_an_unknown_method_with_nodes_is_a_tree():
    table = cut("control-ppo", "tree").with_(methods=["mine"])
    mine = fixed("CartPole-v1", "mine", 900, 901, 902, nodes=(3, 3, 3))
    rows = dict(grids(table, by_cell([mine, fixed("CartPole-v1", "tree", 1, 2, 3)]))[0].rows)
    assert (rows["mine"][0].bold, rows["SYMPOL"][0].bold) == (True, False)


def test_latex_is_escaped_and_balanced():
    table = dataclasses.replace(cut("control-ppo", "tree", "mlp"), title="50% of {A}_B & $C$ #1 ~^\\")
    text = to_latex(table, by_cell([fixed("CartPole-v1", "tree", 11, 12)]))
    assert r"50\% of \{A\}\_B \& \$C\$ \#1 \textasciitilde{}\textasciicircum{}\textbackslash{}" in text
    assert r"CP & PD-C \\" in text
    assert r"\shortstack[r]{11.5 $\pm$ 0.7\\{\scriptsize n=2; paper 500}} & " in text
    assert text.count(r"\toprule") == text.count(r"\bottomrule") == text.count(r"\end{table}") == 2
    bare = re.sub(r"\\.", "", text)
    assert bare.count("{") == bare.count("}")
    assert in_latex("a−b → [c]") == r"a$-$b $\to$ {[}c{]}"


def test_markdown_is_escaped():
    assert in_markdown("a|b <c> *d* _e_ `f` [g](h)\n") == r"a\|b &lt;c&gt; \*d\* \_e\_ \`f\` [g]\(h) "
    assert in_markdown("0.5 [−1.0, 2.0]") == "0.5 [−1.0, 2.0]"


def test_two_records_of_a_cell():
    one = fixed("CartPole-v1", "tree", 1, 2)
    with pytest.raises(RecordError, match="two records of"):
        write(TABLES["control-ppo"], [one, one], None)  # pyright: ignore[reportArgumentType]


def test_provenance():
    several = [fixed("CartPole-v1", "tree", 1, commit="a" * 40, date="2026-11-20T00:00:00", seeds=(7,)),
               fixed("CartPole-v1", "mlp", 1, 2, 3, commit="b" * 40, date="2026-11-22T00:00:00")]  # fmt: skip
    assert provenance(several) == (
        "1 to 3 trainings (seeds 0, 1, 2, 7); 2 test episodes each; 1 M environment steps; "
        "measured 2026-11-20 to 2026-11-22; commits aaaaaaaaaa, bbbbbbbbbb."
    )


def test_numbers_in_words():
    assert [number(x, 1) for x in (-0.04, -0.06, 1234.56, np.inf, -np.inf)] == [
        "0.0",
        "−0.1",
        "1,234.6",
        "∞",
        "−∞",
    ]
    assert interval(Interval(0.5, -1, 2)) == "0.50 [−1.00, 2.00]"
    assert [count(x) for x in (500, 250_000, 1_000_000, 1_500_000)] == ["500", "250 k", "1 M", "1.5 M"]


def test_the_page_of_all_tables(tmp_path):
    tables = [cut("control-ppo", "tree", "mlp"), cut("tree-size", "tree"), TABLES["minigrid"]]
    written = write_docs(records(tables[:2]), tmp_path, tables)
    page = (tmp_path / "tables.md").read_text()
    assert "- [Control with PPO](#control-ppo): 4 of 4 cells" in page
    assert "- [MiniGrid with PPO](#minigrid): 0 of 30 cells" in page
    assert '<a id="tree-size"></a>\n\n## Tree size\n' in page
    images = re.findall(r"\]\((images/tables/[^)]+)\)", page)
    assert {tmp_path / image for image in images} == {*written} - {tmp_path / "tables.md"}
    assert all((tmp_path / image).exists() for image in images)
    again = [path.read_bytes() for path in written]
    assert [path.read_bytes() for path in write_docs(records(tables[:2]), tmp_path, tables)] == again


def test_rows_are_named_once():
    names = [name for name, _ in grids(TABLES["ablation"], {})[0].rows]
    assert names[:2] == ["SYMPOL, paper's settings", "w/o separate architecture"]
    assert len({*names}) == len(TABLES["ablation"].rows)
    assert Row("tree") == Row("tree", "", "ppo")
