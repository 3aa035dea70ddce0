"""Does an agent look for its goal? Train one tree where the goal never moves and one where it does; read and test both.

python examples/goal_misgeneralization.py [--out FOLDER] [--docs PAGE] [--seed 0] [--total-timesteps STEPS]

After the case study of the SYMPOL paper, on Farama's MiniGrid: pip install 'sympol[minigrid]'. All is written into the
folder; where there is a page in Markdown with MARKS in it, the results are written between them, too.
"""

from collections import Counter
from pathlib import Path
from typing import NamedTuple

import tyro
from PIL import Image
from rich.console import Console

import sympol
from sympol.envs.minigrid import random_layouts
from sympol.envs.minigrid.host import rows_of
from sympol.film.stills import Map, Route, contact_sheet, draw_routes

FIXED, RANDOM = "MiniGrid-DistShift1-v0", "sympol/DistShift-Random-v0"
LAYOUTS = [{"strip2_row": row, "goal": goal} for row, goal in random_layouts()]
HOME = LAYOUTS.index({"strip2_row": 2, "goal": (7, 1)})  # which is what FIXED always is
ENDS = {"goal": "reaches the goal", "lava": "walks into lava", "circle": "goes in circles"}
MARKS = "<!-- written by examples/goal_misgeneralization.py -->", "<!-- until here -->"
say = Console(highlight=False, markup=False)


class Walk(NamedTuple):
    """One episode: the cells gone through as (x, y), what was done in each, how it ended, what it looked like."""

    cells: list
    actions: list
    end: str
    frames: list

    def __str__(self):
        return f"{ENDS[self.end]} after {len(self.actions)} steps"


class Study(NamedTuple):
    """A tree and its walks, one a layout: with the goal in sight, and with it hidden."""

    which: str
    env_id: str
    steps: int
    tree: sympol.DecisionTree
    walks: list
    hidden: list


def walk(tree, env, layout, hide_goal=False, render=False):
    """Play to the goal, into lava, or back to where it was: a tree remembers nothing and would go round for ever."""
    observation, _ = env.reset(options=layout)
    world, terminated, states = env.unwrapped, False, set()
    cells, actions, frames = [], [], []
    while True:
        x, y = map(int, world.agent_pos)
        cells.append((x, y))
        frames += [Image.fromarray(env.render())] if render else []
        if terminated or (x, y, world.agent_dir) in states:
            return Walk(cells, actions, world.grid.get(x, y).type if terminated else "circle", frames)
        states.add((x, y, world.agent_dir))
        action = tree.predict(without_goal(tree, observation) if hide_goal else observation)
        actions += tree.actions.words(action)
        observation, _, terminated, _, _ = env.step(action)


def without_goal(tree, observation):
    """The same view with bare floor in place of the goal."""
    observation = observation.copy()
    for group in tree.groups:
        feature = dict(zip(group.categories, group.features, strict=True))
        observation[feature["empty"]] += observation[feature["goal"]]
        observation[feature["goal"]] = 0
    return observation


def study(which, env_id, depth, env, seen, seed, total_timesteps):
    """Train a tree, prune what decides nothing on all that can be seen, let it walk, and say what one reads."""
    say.rule(f"the {which} tree, trained on {env_id}")
    agent = sympol.PPO("tree", env_id, seed=seed, depth=depth).learn(total_timesteps or None)
    with say.status(f"playing all {len(LAYOUTS)} layouts"):
        # not agent.tree(): that need not act as trained on what is never seen in training
        tree = agent.tree(prune=False).prune(observations=seen)
        walks, hidden = ([walk(tree, env, layout, hide) for layout in LAYOUTS] for hide in (False, True))
    it = Study(which, env_id, agent.num_timesteps, tree, walks, hidden)
    say.print(tree.to_text(), listing(tree), *reading(it), sep="\n\n")
    return it


def listing(tree):
    """The tree as Python, without what comes before and after: how the program reads an observation."""
    program = tree.to_python()
    return program[program.index("def act(") : program.index('if __name__ == "__main__"')].strip()


def questions(tree):
    """What the splits ask for, and how often."""
    asked = [(tree.group_of[feature], feature) for feature in tree.feature[~tree.is_leaf].tolist()]
    return Counter(group.categories[group.features.index(feature)] for group, feature in asked)


def success(walks):
    """How many arrived, and what became of the others."""
    ends = Counter(walk.end for walk in walks)
    others = "".join(f", {ends[end]} {ENDS[end].split(' ', 1)[1]}" for end in ("lava", "circle") if ends[end])
    return f"{ends['goal']} of {len(walks)} ({ends['goal'] / len(walks):.1%}{others})"


def reading(it):
    """Sentences: what one reads in the tree, and what one sees when it walks."""
    asked, home, blind = questions(it.tree), it.walks[HOME], it.hidden[HOME]
    counts = ", ".join(f"{what} {number} ×" for what, number in asked.most_common())
    yield f"Questions: {asked.total()} ({counts}), {asked['goal'] or 'none'} of them about the goal."
    so = ": it gets there without looking for it" if blind.end == "goal" else ""
    yield f"In {FIXED} it {home}. With the goal hidden from it, it {blind}{so}."
    yield f"Goals reached: {success(it.walks)}; with the goal hidden {success(it.hidden)}."


def shown(first):
    """The layouts to look at: at home, and for each row of lava the farthest goal that the first tree misses."""
    yield HOME
    for row in (2, 5):
        missed = [
            i for i, it in enumerate(first.walks) if it.end != "goal" and LAYOUTS[i]["strip2_row"] == row
        ]
        yield max(missed, key=lambda i: sum(LAYOUTS[i]["goal"]), default=HOME)


def title(i):
    return FIXED if i == HOME else "Lava in row {strip2_row}, goal at {goal}".format(**LAYOUTS[i])


def draw_walk(it, i, env, file):
    """Draw a walk step by step; return the lines of a page about it."""
    played = walk(it.tree, env, LAYOUTS[i], render=True)
    words = [*(f"{step}  {action}" for step, action in enumerate(played.actions, 1)), ENDS[played.end]]
    contact_sheet(played.frames, words).save(file, optimize=True)
    return f"{title(i)}: it {played}.\n\n![{played}](HERE/{file.name})\n"


def draw_maps(studies, env, out):
    """Draw the routes of both trees through the layouts shown, and through all."""
    maps, names = [], [f"{it.which} tree" for it in studies]
    for i, layout in enumerate(LAYOUTS):
        env.reset(options=layout)
        routes = [Route(it.walks[i].cells, it.walks[i].end == "goal") for it in studies]
        maps.append(Map(rows_of(env), routes, title(i)))
    draw_routes([maps[i] for i in shown(studies[0])], names=names).save(out / "routes.png", optimize=True)
    small = [each._replace(title="") for each in maps]
    draw_routes(small, columns=7, cell=0.13, names=names).save(out / "all-routes.png", optimize=True)


def report(studies, env, out, seed):
    """Write trees and pictures into a folder; yield the lines of a page about them, HERE being that folder."""
    table = {
        f"seed {seed}": lambda it: f"{it.which} tree",
        "---": lambda it: "---",
        "trained on": lambda it: f"{it.env_id}, {it.steps:,} steps",
        "questions": lambda it: questions(it.tree).total(),
        "about the goal": lambda it: questions(it.tree)["goal"],
        "goals reached, all layouts": lambda it: f"**{success(it.walks)}**",
        "with the goal hidden": lambda it: success(it.hidden),
    }
    yield from (f"| {what} | {' | '.join(str(cell(it)) for it in studies)} |" for what, cell in table.items())
    for it in studies:
        it.tree.plot(out / f"{it.which}-tree.svg")
        (out / f"{it.which}_tree.py").write_text(it.tree.to_python(), "utf-8")
        yield f"\n## The {it.which} tree\n\n![the {it.which} tree](HERE/{it.which}-tree.svg)\n"
        yield f"As Python ([the whole program](HERE/{it.which}_tree.py)):\n"
        yield f"```python\n{listing(it.tree)}\n```\n\n{' '.join(reading(it))}\n"
        for number, i in enumerate(shown(studies[0]), 1):
            yield draw_walk(it, i, env, out / f"{it.which}-walk-{number}.png")
    draw_maps(studies, env, out)
    yield "## Both\n\n![routes of both trees](HERE/routes.png)\n\n![in all layouts](HERE/all-routes.png)"


def main(out: Path = Path("case-study"), docs: Path | None = None, seed: int = 0, total_timesteps: int = 0):
    """Train two trees, read and test them."""
    out.mkdir(parents=True, exist_ok=True)
    env, seen = (spec := sympol.resolve(RANDOM)).make_host(render_mode="rgb_array"), spec.all_observations()
    tasks = ("first", FIXED, 3), ("second", RANDOM, 8)  # a deep first tree would learn its one world by heart
    studies = [study(*task, env, seen, seed, total_timesteps) for task in tasks]
    with say.status("drawing"):
        page = "\n".join(report(studies, env, out, seed))
    (out / "README.md").write_text(f"# Does it look for its goal?\n\n{page.replace('HERE', '.')}\n", "utf-8")
    if docs:
        here = out.resolve().relative_to(docs.resolve().parent).as_posix()
        before, _, rest = docs.read_text("utf-8").partition(MARKS[0])
        after = MARKS[1] + rest.partition(MARKS[1])[2]
        docs.write_text("\n\n".join((before + MARKS[0], page.replace("HERE", here), after)), "utf-8")
    say.print(f"\neverything is in {out}; begin with {out / 'README.md'}")


if __name__ == "__main__":
    tyro.cli(main)
