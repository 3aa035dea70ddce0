"""The teacher's road: from a network to a large tree, and from there, in turns, a size less and a polish.

1. A teacher is trained, or given.
2. It is distilled into several trees that may be a few times as large as those asked for: what a large tree earns, a
   small one pruned out of it by return can earn, too, while a small one that only imitates earns next to nothing.
3. The best two are pruned by return to the limit, and their numbers are polished (`sympol.refine.polish`), which leaves
   the better one: CART puts thresholds where the teacher's answers change, and not where the tree, which is cruder, had
   better change its own.
4. The same with half the limit, and with a quarter, from the tree before.

Each step leaves what it found in a folder of its own. What is done is not done again, and a polish goes on.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..agents import load
from ..distill import Teacher, load_sb3
from ..distill.imitate import Play
from ..envs.registry import resolve
from ..play import Episodes, Purpose, play
from ..refine.arena import Arena, make_arena
from ..refine.evolve import Budget
from ..refine.polish import Polished, polish
from ..teachers import DISCRETIZE, as_teacher, default_method, distill_policy
from ..trees import DecisionTree
from .found import Found, keep, kept
from .front import Spent
from .site import Site, chained, part, trained

TRAINING = 0.5
"""Of the share, at most, for training a teacher."""
DISTILLING = 0.7
"""Of the share of seconds, after which no further tree is distilled."""
POLISHING = 0.4
"""Of a share of steps."""
TIMES = (4, 4, 4, 2)
"""How large distilled trees may be, in limits."""
ITERATIONS = 12
"""Trees that are fitted one after the other, of which distillation takes the best."""
STARTS = 2
"""Trees that are polished side by side at first."""
FIRST, LAST = 32, 128
"""Episodes of a race: for all, and for the best few."""
FAR = 1 << 30
"""Polishing plays episodes from here on."""
EPISODES = {"jax": 64, "envpool": 32, "host": 16}
"""Of a generation of polishing and of an iteration of distillation, by what steps them."""
POLISHED = "teacher + polish"
APART = 1 << 27
"""Episodes of one size."""


def taught(site: Site) -> None:
    """Go the road; what is found is in the site's folder then."""
    found = _distilled(site)
    keep(site.folder, found, finished=False)
    for stage in stages(site.plan.max_nodes):
        found += _polished(site, found, stage)
        keep(site.folder, found, finished=False)
    keep(site.folder, found, finished=True)


@dataclass(frozen=True)
class Stage:
    """A size to polish."""

    nodes: int
    """At most."""
    next_nodes: int
    """To which the tree is pruned afterwards."""
    part: float
    """Of the steps for polishing."""
    part_of_rest: float
    """Of the seconds that are left."""
    first_episode: int


def stages(max_nodes: int) -> list[Stage]:
    """The limit, half of it, and half of that, as long as there is a question to polish."""
    sizes = [size for size in (max_nodes, (max_nodes - 1) // 2, (max_nodes - 3) // 4) if size >= 3]
    sizes = [size - 1 + size % 2 for size in sizes]
    made, rest = [], 1.0
    for i, (size, end) in enumerate(zip(sizes, [*sizes, 1][1:], strict=True)):
        of_rest = 1.0 if end == 1 else 0.5
        made.append(Stage(size, end, rest * of_rest, of_rest, FAR + i * APART))
        rest -= rest * of_rest
    return made


def _distilled(site: Site) -> list[Found]:
    """Trees made of the teacher, and the best of them pruned by return to the limit."""
    folder = site.folder / "distilled"
    before, finished = kept(folder)
    if finished:
        return before
    if site.plan.teacher:
        teacher, cost = _given(site), Spent()
    else:
        teacher, spent = trained(site, "mlp", site.folder / "teacher", part(site.share, TRAINING))
        cost = Spent(teacher_steps=spent.env_steps, seconds=spent.seconds)
    asked = as_teacher(teacher)
    warn_of_poor_teacher(asked)
    trees = _trees(site, teacher, asked, before, cost)
    arena, began = make_arena(site.spec, site.seed), time.perf_counter()
    best = best_of(arena, [one.tree for one in trees], STARTS)
    cost = trees[-1].spent + Spent(env_steps=arena.steps, seconds=time.perf_counter() - began)
    found = list(trees)
    for tree in best:
        found += chained(site, tree, "teacher", cost, smallest=site.plan.max_nodes)
        cost = found[-1].spent
    within = [one for one in found if one.tree.n_nodes <= site.plan.max_nodes]
    keep(folder, within, finished=True)
    return within


def _trees(site: Site, policy: Any, teacher: Teacher, before: Sequence[Found], cost: Spent) -> list[Found]:
    """Large trees that imitate the teacher, besides those of ``before``, as many as time allows; one at least."""
    episodes, found = EPISODES[site.spec.backend], list(before)
    soft = default_method(policy, teacher) == DISCRETIZE
    limits = [0] if soft else [max(3, times * (site.plan.max_nodes + 1) - 1) for times in TIMES]
    for i, limit in list(enumerate(limits))[len(before) :]:
        spent = found[-1].spent if found else cost
        if found and spent.seconds > DISTILLING * site.share.seconds:
            break
        arena, began = make_arena(site.spec, site.seed), time.perf_counter()
        if soft:
            tree = distill_policy(policy, DISCRETIZE, env=teacher.spec)
        else:
            tree = distill_policy(
                policy,
                "dagger",
                env=teacher.spec,
                seed=(site.seed + i) % 2**32,
                max_nodes=limit,
                num_iterations=ITERATIONS,
                episodes_per_iteration=episodes,
                num_validation_episodes=2 * episodes,
                play_tree=player(arena),
            )
        spent += Spent(env_steps=arena.steps, seconds=time.perf_counter() - began)
        found.append(Found(tree, "teacher", spent))
        keep(site.folder / "distilled", found, finished=False)
    return found


def _polished(site: Site, found: Sequence[Found], stage: Stage) -> list[Found]:
    """The best of the trees that are no larger, polished, and pruned by return."""
    folder = site.folder / f"{stage.nodes}-nodes"
    before, finished = kept(folder)
    if finished:
        return before
    arena, began = make_arena(site.spec, site.seed), time.perf_counter()
    road_so_far = found[-1].spent
    if before:
        starts, done = [before[0].tree], before[0].spent
    else:
        starts, done = _best_below(stage.nodes, found, arena), road_so_far

    def spent() -> Spent:
        return done + Spent(env_steps=arena.steps, seconds=time.perf_counter() - began)

    def tell(now: Polished) -> None:
        keep(folder, [Found(now.tree, POLISHED, spent())], finished=False)

    so_far = spent()
    better = polish(
        starts,
        arena,
        budget=Budget(
            site.share.steps * POLISHING * stage.part - (so_far.env_steps - road_so_far.env_steps),
            (site.share.seconds - road_so_far.seconds) * stage.part_of_rest
            - (so_far.seconds - road_so_far.seconds),
        ),
        episodes=EPISODES[site.spec.backend],
        first_episode=stage.first_episode,
        seed=site.seed,
        progress=tell,
    )
    more = chained(site, better, POLISHED, spent(), smallest=stage.next_nodes)
    keep(folder, more, finished=True)
    return more


def _best_below(nodes: int, found: Sequence[Found], arena: Arena) -> list[DecisionTree]:
    """The best of the trees that have at most so many nodes, and more than half as many if there are such."""
    fit = [one.tree for one in found if one.tree.n_nodes <= nodes]
    return best_of(arena, [tree for tree in fit if tree.n_nodes > nodes // 2] or fit, STARTS)


def best_of(arena: Arena, trees: Sequence[DecisionTree], number: int) -> list[DecisionTree]:
    """The best of some different trees: all play a few episodes, the best few of them more."""
    trees = list(dict.fromkeys(trees))
    for episodes, kept_on in ((FIRST, 2 * number), (LAST, number)):
        means = arena.play(trees, range(episodes)).returns.mean(axis=1, dtype=np.float64)
        trees = [trees[i] for i in np.argsort(-means, kind="stable")[:kept_on]]
    return trees


def player(arena: Arena) -> Play:
    """The arena as distillation plays trees: on episodes far from those that pruning plays.

    Only where something is to be learnt from what was seen it is observed, which takes as long again.
    """

    def play_tree(tree: DecisionTree, number: int, seed: int, purpose: Purpose) -> Episodes:
        word = int(np.random.SeedSequence([seed, purpose == "distill"]).generate_state(1)[0])
        episodes = range(first := (1 + word % 2**19) << 10, first + number)
        played = arena.play([tree], episodes)
        seen = np.zeros((0, tree.n_features), np.float32)
        if purpose == "distill":
            seen = arena.observe(tree, episodes)
        return Episodes(played.returns[0], played.lengths[0], seen)

    return play_tree


def _given(site: Site) -> Any:
    path = Path(site.plan.teacher)
    if path.is_dir():
        return load(path)
    return load_sb3(
        path, resolve(site.plan.env, env_kwargs=site.plan.env_kwargs, backend="host"), trust=False
    )


def warn_of_poor_teacher(teacher: Teacher) -> None:
    """Say so where a teacher earns less than chance does."""
    space = teacher.spec.action_space
    space.seed(0)
    its = play(teacher, teacher.spec, 10, seed=0, purpose="distill").returns.mean()
    chance = play(
        lambda x: np.stack([space.sample() for _ in x]), teacher.spec, 10, seed=0, purpose="distill"
    )
    if its < chance.returns.mean():
        warnings.warn(
            f"the teacher earns {its:.1f}, less than a random policy does, {chance.returns.mean():.1f}; its trees "
            "will be poor",
            stacklevel=2,
        )
