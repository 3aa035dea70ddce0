"""Roads to small trees. Each is a task of its own, for any process to do, and leaves what it found in its folder.

| road | what |
|---|---|
| scratch | our trees trained by PPO, every other one within the limit of nodes; each pruned by return, node by node |
| teacher | an MLP trained by PPO, distilled at several depths; the best trained on by PPO; pruned by return |
| evolve | whatever the other roads found, and random trees, changed at random (`sympol.refine.evolve`) |
"""

from __future__ import annotations

import json
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..agents import PPO, Agent, Callback, Report, load
from ..algos.start import Start
from ..compilation import use_disk_cache
from ..distill import Teacher, load_sb3
from ..distill.imitate import Play
from ..envs.registry import resolve
from ..envs.spec import EnvSpec
from ..experiments.workers import Task
from ..play import Episodes, Purpose, play
from ..refine.arena import Arena, make_arena
from ..refine.evolve import Budget, Heat, evolve
from ..refine.shrink import chain
from ..runs.checkpoint import write_atomically
from ..runs.folder import Run
from ..teachers import DISCRETIZE, as_teacher, default_method, distill_policy
from ..training import finish, go_on, has_run, keep_in
from ..trees import DecisionTree
from .found import HEAT, Found, keep, kept
from .front import Spent
from .plan import Plan

EPISODES = {"jax": 256, "envpool": 32, "host": 16}
"""Episodes in which evolution compares, by what steps them."""
LARGEST = 127
"""Nodes of the trees that evolution starts from, at most, however small those are that are asked for."""
CRITIC_WARMUP = 0.1
"""Of the training that goes on from a distilled tree."""
ITERATIONS = 10
"""Trees that are fitted one after the other, of which distillation takes the best."""
ENOUGH = 10.0
"""Seconds that another training is worth beginning with."""


def tasks(plan: Plan, folder: Path, road: str, share: Budget) -> list[Task]:
    """What a road is made of. ``share`` is its part of the budget."""
    number = {"scratch": plan.trainings, "teacher": 1, "evolve": plan.islands}[road]
    return [
        Task(
            f"{road} {i + 1} of {number}" if number > 1 else road,
            f"{__name__}:walk",
            {
                "plan": plan.to_dict(),
                "folder": str(folder),
                "road": road,
                "index": i,
                "seconds": min(share.seconds, 1e9),
                "steps": min(share.steps / number, 1e15),
            },
        )
        for i in range(number)
    ]


def place(folder: Path, road: str, index: int) -> Path:
    """Where a task leaves what it found."""
    return folder / road / str(index)


def walk(plan: dict[str, Any], folder: str, road: str, index: int, seconds: float, steps: float) -> list[str]:
    """Do one task of `tasks`; what it has found is in its `place` then. Return what was warned of."""
    use_disk_cache()
    asked = Plan.from_dict(plan)
    spec = resolve(asked.env, env_kwargs=asked.env_kwargs)
    site = Site(asked, spec, Path(folder), index, place(Path(folder), road, index), Budget(steps, seconds))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        if not kept(site.folder)[1]:
            {"scratch": _scratch, "teacher": _teacher, "evolve": _evolve}[road](site)
    return list(dict.fromkeys(str(one.message) for one in caught if issubclass(one.category, UserWarning)))


@dataclass(frozen=True)
class Site:
    """Where a road is built, and with what."""

    plan: Plan
    spec: EnvSpec
    root: Path
    """The search's folder."""
    index: int
    folder: Path
    """This task's."""
    share: Budget

    @property
    def seed(self) -> int:
        """Of everything random in this task."""
        words = [self.plan.seed, self.index, *self.folder.parent.name.encode()]
        return int(np.random.SeedSequence(words).generate_state(1)[0])


def _scratch(site: Site) -> None:
    began = time.perf_counter()
    limit = 0 if site.index % 2 == 0 else site.plan.max_nodes
    agent, spent = _trained(site, "tree", site.folder / "run", site.share, max_nodes=limit)
    found = _chain(site, agent.tree(), "scratch", spent, began)
    keep(site.folder, found, finished=True)


def _teacher(site: Site) -> None:
    began = time.perf_counter()

    def left() -> float:
        return site.share.seconds - (time.perf_counter() - began)

    if site.plan.teacher:
        teacher, cost = _given(site), Spent()
    else:
        teacher, cost = _trained(site, "mlp", site.folder / "teacher", _part(site.share, 0.5))
        cost = Spent(teacher_steps=cost.env_steps, seconds=cost.seconds)
    asked = as_teacher(teacher)
    _warn_of_poor_teacher(asked)
    arena, found, full = make_arena(site.spec, site.seed), [], []
    for depth in _depths(site):
        full.append(_distilled(teacher, asked, depth, site.seed, arena))
        found += _chain(site, full[-1], "teacher", cost, began)
        keep(site.folder, found, finished=False)
        if left() < 0.35 * site.share.seconds:
            break
    if left() > ENOUGH:
        best = full[int(arena.play(full, range(128)).returns.mean(axis=1).argmax())]
        start = Start(best, critic_warmup=CRITIC_WARMUP, origin="the best tree distilled from the teacher")
        share = Budget(0.4 * site.share.steps, left() - ENOUGH / 2)
        within = {"start": start, "max_nodes": site.plan.max_nodes}
        tuned, more = _trained(site, "tree", site.folder / "tuned", share, **within)
        found += _chain(site, tuned.tree(), "teacher + ppo", cost + more, began)
    keep(site.folder, found, finished=True)


def _evolve(site: Site) -> None:
    before, _ = kept(site.folder)
    done = before[-1].spent if before else Spent()
    roads = [road for road in site.plan.roads if road != "evolve"]
    others = [
        one for road in roads for folder in sorted((site.root / road).glob("*")) for one in kept(folder)[0]
    ]
    name = " + ".join([*roads, "evolve"]) if others else "evolve"
    starts = [one.tree for one in (*others, *before) if one.tree.n_nodes <= LARGEST]
    arena = make_arena(site.spec, site.seed)

    def found(heat: Heat) -> list[Found]:
        here = done + Spent(env_steps=heat.steps, seconds=heat.seconds)
        return [Found(tree, name, here) for tree in heat.trees]

    def tell(heat: Heat) -> None:
        keep(site.folder, found(heat), finished=False)
        write_atomically(site.folder / HEAT, json.dumps(heat.best).encode())

    left = Budget(site.share.steps - done.env_steps, site.share.seconds - done.seconds)
    last = evolve(
        arena,
        starts or [_indifferent(site.spec)],
        max_nodes=site.plan.max_nodes,
        budget=left,
        episodes=EPISODES[site.spec.backend],
        seed=site.seed,
        progress=tell,
    )
    keep(site.folder, found(last), finished=True)


def _trained(site: Site, policy: str, folder: Path, share: Budget, **options: Any) -> tuple[Agent, Spent]:
    """Train in a run's folder, or go on there, until the end or until the share is spent."""
    began = time.perf_counter()
    if has_run(folder):
        run = Run.open(folder)
        agent = go_on(run)
    else:
        agent = PPO(policy, site.spec, seed=site.seed, **options)
        if share.steps < agent.config.total_timesteps:
            agent = PPO(policy, site.spec, seed=site.seed, total_timesteps=int(share.steps), **options)
        run = Run.create(folder, site.spec, agent.config, agent.seed, overwrite=True, start=agent.start)

    def in_time(report: Report) -> bool:
        return time.perf_counter() - began < share.seconds

    callbacks: list[Callback] = [keep_in(run), in_time]
    if agent.num_timesteps < agent.config.total_timesteps:
        agent.learn(callback=callbacks, progress_bar=False)
    run.save_summary(finish(agent, run, None, None, 0))
    return agent, Spent(env_steps=agent.num_timesteps, seconds=time.perf_counter() - began)


def _chain(site: Site, tree: DecisionTree, road: str, spent: Spent, began: float) -> list[Found]:
    """The tree, and smaller and smaller parts of it."""
    arena = make_arena(site.spec, site.seed)
    smaller = chain(tree, arena, observations=site.spec.all_observations())
    cost = replace(spent, env_steps=spent.env_steps + arena.steps, seconds=time.perf_counter() - began)
    return [Found(one.tree, f"{road} + shrink" if i else road, cost) for i, one in enumerate(smaller)]


def _distilled(policy: Any, teacher: Teacher, depth: int, seed: int, arena: Arena) -> DecisionTree:
    method = default_method(policy, teacher)
    if method == DISCRETIZE:
        return distill_policy(policy, method, env=teacher.spec)
    options = {"num_iterations": ITERATIONS, "play_tree": _player(arena)}
    return distill_policy(policy, method, depth, env=teacher.spec, seed=seed, **options)


def _player(arena: Arena) -> Play:
    """The arena as distillation plays trees: on episodes far from those that pruning plays."""

    def play_tree(tree: DecisionTree, number: int, seed: int, purpose: Purpose) -> Episodes:
        word = int(np.random.SeedSequence([seed, purpose == "distill"]).generate_state(1)[0])
        episodes = range(first := (1 + word % 2**20) << 10, first + number)
        played = arena.play([tree], episodes)
        return Episodes(played.returns[0], played.lengths[0], arena.observe(tree, episodes))

    return play_tree


def _depths(site: Site) -> Sequence[int]:
    """Of distilled trees: complete ones of about the size asked for, and some that are pruned to it."""
    deepest = max(2, int(np.ceil(np.log2(site.plan.max_nodes + 1))))
    return [depth for depth in (deepest, deepest + 1, deepest - 1) if depth >= 1]


def _given(site: Site) -> Any:
    path = Path(site.plan.teacher)
    if path.is_dir():
        return load(path)
    return load_sb3(
        path, resolve(site.plan.env, env_kwargs=site.plan.env_kwargs, backend="host"), trust=False
    )


def _warn_of_poor_teacher(teacher: Teacher) -> None:
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


def _indifferent(spec: EnvSpec) -> DecisionTree:
    """One leaf, for evolution to begin with."""
    none = np.zeros(0, int), np.zeros(0), np.zeros((1, spec.actions.n_outputs))
    return DecisionTree.from_complete(*none, actions=spec.actions, **spec.features.reading())


def _part(share: Budget, part: float) -> Budget:
    return Budget(share.steps * part, share.seconds * part)
