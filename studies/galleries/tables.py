"""Tables of several runs of a task, in Markdown: what they reached beside targets and published returns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from sympol.results.formatting import as_printed, in_markdown, number, pipe_table
from sympol.runs.formatting import decimals
from sympol.search.front.formatting import cost_line, short_count
from sympol.search.front.front import (
    BestUnderSize,
    Front,
    Point,
    best_under_sizes,
    require_one_task,
    sizes_of,
)

from .published import Target, best_published, targets

NO_TREE = "none so small"
_NOTHING = "—"


def markdown_of_runs(fronts: Sequence[Front], sizes: Sequence[Target] = ()) -> str:
    """Return a table with a row for each size: target, published return, mean and spread, and each run.

    Args:
        fronts: Runs of one task.
        sizes: The rows; by default the task's targets, or all sizes of points where it has none.

    Raises:
        FrontError: See `best_under_sizes`.
    """
    environment, sizes = require_one_task(fronts), sizes or _sizes(fronts)
    goals = [_goal(target) for target in sizes]
    others = [_published(environment, target.nodes) for target in sizes]
    shown = [(name, cells) for name, cells in (("target", goals), ("published", others)) if any(cells)]
    columns = ["at most", *(name for name, _ in shown), "test return"]
    columns += [f"seed {front.seed}" for front in fronts]
    places, rows = _decimals(fronts), []
    for i, (target, reached) in enumerate(zip(sizes, _summaries(fronts, sizes), strict=True)):
        row = [f"{target.nodes} nodes", *(cells[i] or _NOTHING for _, cells in shown)]
        row += [_mean_beside(target, reached, places), *(_run(point, places) for _, point in reached.runs)]
        rows.append(row)
    costs = "\n".join(f"- seed {front.seed}: {cost_line(front)}" for front in fronts)
    return f"{pipe_table(columns, rows)}\n\n{costs}\n"


def markdown_of_tasks(tasks: Iterable[Sequence[Front]]) -> str:
    """Return one table of many tasks, with the test returns of all runs in its last column.

    Raises:
        FrontError: See `best_under_sizes`.
    """
    rows = []
    for fronts in tasks:
        environment, sizes, places = fronts[0].environment, _sizes(fronts), _decimals(fronts)
        for i, (target, reached) in enumerate(zip(sizes, _summaries(fronts, sizes), strict=True)):
            nodes = [point.nodes for _, point in reached.runs if point is not None]
            size = f"{min(nodes)} to {max(nodes)}" if len({*nodes}) > 1 else "".join(map(str, nodes[:1]))
            rows.append(
                [
                    environment if i == 0 else "",
                    str(target.nodes),
                    _published(environment, target.nodes) or _NOTHING,
                    _mean(reached, places),
                    size or _NOTHING,
                    " ".join(_run(point, places).split(" ")[0] for _, point in reached.runs),
                ]
            )
    columns = ("task", "at most", "published", "test return", "nodes", "each run")
    return f"{pipe_table(columns, rows)}\n"


def markdown_by_methods(groups: Sequence[Sequence[Front]]) -> str:
    """Return a table with a row for each choice of methods: what several runs reached with it.

    Raises:
        FrontError: See `best_under_sizes`.
    """
    environment = require_one_task([runs[0] for runs in groups][:1])
    sizes = [target.nodes for target in targets(environment)] or sizes_of(groups[-1])
    places = min(_decimals(runs) for runs in groups)
    columns = ["methods", "runs", *(f"at most {size} nodes" for size in sizes), "steps", "seconds"]
    rows = []
    for runs in groups:
        steps = sum(front.cost.steps for front in runs) / len(runs)
        seconds = sum(front.cost.seconds for front in runs) / len(runs)
        methods = in_markdown(" + ".join(map(str, runs[0].methods)) or "all")
        reached = [_mean(summary, places) for summary in best_under_sizes(runs, sizes)]
        rows.append([methods, str(len(runs)), *reached, short_count(round(steps)), number(seconds, 0)])
    return f"{pipe_table(columns, rows)}\n\nTest returns; steps (with a teacher's) and seconds are means over runs.\n"


def _sizes(fronts: Sequence[Front]) -> Sequence[Target]:
    """Return the task's targets; where there are none, the sizes of all points."""
    return targets(require_one_task(fronts)) or [Target(size, None) for size in sizes_of(fronts)]


def _summaries(fronts: Sequence[Front], sizes: Sequence[Target]) -> list[BestUnderSize]:
    return best_under_sizes(fronts, [target.nodes for target in sizes])


def _decimals(fronts: Sequence[Front]) -> int:
    return min(decimals(point.mean) for front in fronts for point in front.points)


def _goal(target: Target) -> str:
    return target.words if target.mean is None else as_printed(target.mean)


def _published(environment: str, nodes: int) -> str:
    """Format the best published return of at most so many nodes, its size in brackets."""
    best = best_published(environment, nodes)
    if best is None:
        return ""
    label = best.label.removeprefix("published").removeprefix(", ")
    return f"{as_printed(best.mean)} ({', '.join(filter(None, [f'{best.nodes:g}', label]))})"


def _mean_beside(target: Target, reached: BestUnderSize, places: int) -> str:
    """Format the mean over runs, in bold where it reaches the target."""
    text = _mean(reached, places)
    is_reached = target.mean is not None and reached.mean is not None and reached.mean >= target.mean
    return f"**{text}**" if is_reached else text


def _mean(reached: BestUnderSize, places: int) -> str:
    if reached.mean is None:
        return NO_TREE
    return number(reached.mean, places) + ("" if reached.std is None else f" ± {number(reached.std, places)}")


def _run(point: Point | None, places: int) -> str:
    if point is None or point.test is None:
        return NO_TREE
    return f"{number(point.test.mean, places)} ({point.nodes})"
