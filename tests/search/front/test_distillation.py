"""Distillation: its stages, what continues, and that nothing is done twice."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from sympol import DecisionTree
from sympol.distill import distill
from sympol.envs.registry import resolve
from sympol.search.budget import Budget, Cost
from sympol.search.evaluators import make_evaluator
from sympol.search.front import distillation, task
from sympol.search.front.config import SearchConfig
from sympol.search.front.distillation import distillation_player
from sympol.search.front.messages import Candidate, TaskRequest, load_candidates, save_candidates
from sympol.search.front.task import FINE_TUNING, TaskContext, best_by_halving, stages

from ...distill.teachers import cartpole, pendulum
from ..bandit import Bandit

SPEC = resolve("CartPole-v1")


def balanced(n: int, threshold: float = 0.0) -> DecisionTree:
    """A tree of n nodes that goes where the pole falls."""
    depth = (n + 1).bit_length() - 2
    splits = 2**depth - 1
    features, thresholds = (
        np.full(splits, 3),
        np.linspace(-1, 1, splits) + threshold if splits > 1 else [threshold],
    )
    values = np.eye(2)[np.arange(2**depth) % 2]
    return DecisionTree.from_complete(
        features, np.asarray(thresholds), values, actions=SPEC.actions, **SPEC.features.metadata()
    )


@pytest.mark.parametrize(
    ("max_nodes", "sizes"),
    [
        (63, [127, 63, 49, 39, 31, 23, 19, 15]),
        (31, [63, 31, 23, 19, 15, 11, 9, 7]),
        (9, [19, 9, 5, 3]),
        (5, [11, 5, 3]),
        (3, [7, 3]),
        (1, []),
    ],
)
def test_sizes_fall_step_by_step_as_long_as_there_is_a_question(max_nodes: int, sizes: list[int]):
    made = stages(max_nodes)
    assert [stage.nodes for stage in made] == sizes
    assert [stage.next_nodes for stage in made] == [*sizes[1:], 1][: len(sizes)]


@pytest.mark.parametrize(
    ("max_nodes", "times"),
    [
        (127, [1, 4, 1, 1, 4, 0.5, 0.5, 0.5]),
        (63, [1, 4, 1, 1, 4, 0.5, 0.5, 0.5]),
        (31, [1, 4, 1, 1, 4, 0.5, 0.5, 0.5]),
        (7, [1, 4, 1, 4]),
        (3, [1, 4]),
    ],
)
def test_stages_spend_all_there_is_and_share_no_episodes(max_nodes: int, times: list[float]):
    made = stages(max_nodes)
    rest, spent = 1.0, []
    for stage in made:
        spent.append(rest * stage.part)
        rest -= spent[-1]
    assert rest == pytest.approx(0)
    # what is asked for and half of it have four times as much as what is between them
    assert spent == pytest.approx([time / sum(times) for time in times])
    assert all(a.episodes.start + a.episodes.size == b.episodes.start for a, b in pairwise(made))
    assert made[0].episodes.start == FINE_TUNING.start
    assert made[-1].episodes.start + made[-1].episodes.size <= 2**31


def test_what_goes_on_is_the_best_of_the_race():
    truth = balanced(7)
    evaluator = Bandit(truth)
    trees = [balanced(7, shift) for shift in (1.0, 0.4, 0.01, -0.6, 2.0, 0.9)]
    means = evaluator.returns_of(trees[2], range(128)).mean()
    assert all(
        evaluator.returns_of(tree, range(128)).mean() < means for tree in trees if tree is not trees[2]
    )
    assert best_by_halving(evaluator, trees, 1) == [trees[2]]
    assert best_by_halving(evaluator, [trees[0]] * 3, 2) == [trees[0]]  # each once
    second = sorted(trees, key=lambda tree: -evaluator.returns_of(tree, range(128)).mean())[:2]
    assert best_by_halving(evaluator, trees, 2) == second


def test_distillation_plays_what_the_evaluator_plays():
    evaluator = make_evaluator(SPEC, 3)
    tree = balanced(7)
    learnt, chosen = (
        distillation_player(evaluator)(tree, 5, 11, purpose) for purpose in ("distill", "validation")
    )
    assert learnt.observations.shape == (learnt.lengths.sum(), 4)
    assert chosen.observations.shape == (0, 4)  # nobody learns from it
    assert learnt.returns.tolist() != chosen.returns.tolist()  # other episodes
    again = distillation_player(make_evaluator(SPEC, 3))(tree, 5, 11, "distill")
    np.testing.assert_array_equal(learnt.returns, again.returns)
    assert learnt.returns.tolist() == learnt.lengths.tolist()  # CartPole pays one a step


def test_what_is_done_is_not_done_again_and_fine_tuning_resumes(tmp_path, monkeypatch):
    plan = SearchConfig("CartPole-v1", max_nodes=7, methods=("teacher",), budget="20M steps", teachers=1)
    context = TaskContext(TaskRequest(plan, tmp_path, "teacher", 0, Budget(20e6, 1e9)), SPEC)
    distilled = [Candidate(balanced(7), "teacher", Cost(1000, 50, 0, 2.0))]
    save_candidates(context.folder / "distilled", distilled, finished=True)
    half_tuned = balanced(7, 0.05)
    so_far = Cost(400_000, 50, 0, 3.0)
    sizes = [stage.nodes for stage in stages(7)]
    save_candidates(
        context.folder / f"{sizes[0]}-nodes",
        [Candidate(half_tuned, "teacher + fine-tune", so_far)],
        finished=False,
    )
    tuned = []

    def finetune_thresholds(trees, evaluator, *, budget, **options):
        tree = trees[0]
        tuned.append((trees, budget, options["first_episode"]))
        return replace(tree, threshold=tree.threshold + np.float32(0.01) * ~tree.is_leaf)

    monkeypatch.setattr(task, "finetune_thresholds", finetune_thresholds)
    distillation.run_distillation(context)
    first, budget, at = tuned[0]
    assert first == [half_tuned]
    assert budget.steps == (20e6 - 1050) * stages(7)[0].part - (so_far.env_steps - 1000)
    assert at == FINE_TUNING.start
    for (trees, *_), size in zip(tuned, sizes, strict=True):
        assert all(tree.n_nodes <= size for tree in trees)
    saved = load_candidates(context.folder)
    found = saved.candidates
    assert saved.finished
    assert found[0] == distilled[0]
    costs = [one.cost.env_steps for one in found]
    assert costs == sorted(costs)  # each step adds to the one before
    assert {one.method for one in found} == {"teacher", "teacher + fine-tune", "teacher + fine-tune + prune"}
    distillation.run_distillation(context)
    assert len(tuned) == len(sizes)


def test_each_distilled_tree_is_kept_at_once_and_not_distilled_again(tmp_path, monkeypatch):
    plan = SearchConfig("CartPole-v1", max_nodes=7, methods=("teacher",), budget="20M steps", teachers=1)
    context = TaskContext(TaskRequest(plan, tmp_path, "teacher", 0, Budget(20e6, 100.0)), SPEC)
    made, teacher = [], cartpole()

    def distil(policy, method, *, max_nodes, **options):
        if len(made) == 2:
            raise KeyboardInterrupt
        made.append((max_nodes, options["seed"]))
        return balanced(15, 0.1 * len(made))

    monkeypatch.setattr(distillation, "distill_policy", distil)
    with pytest.raises(KeyboardInterrupt):
        distillation.distilled_trees(context, teacher, teacher, [], Cost())
    saved = load_candidates(context.folder / "distilled")
    before = list(saved.candidates)
    assert len(before) == 2
    assert not saved.finished
    assert made == [(31, context.seed), (31, context.seed + 1)]
    monkeypatch.setattr(
        distillation, "distill_policy", lambda *_, max_nodes, seed, **__: balanced(max_nodes, seed % 7)
    )
    found = distillation.distilled_trees(context, teacher, teacher, before, Cost())
    assert found[:2] == before
    assert [one.tree.n_nodes for one in found[2:]] == [
        8 * times - 1 for times in distillation.DISTILLED_SIZES[2:]
    ]
    late = [replace(before[0], cost=Cost(seconds=71.0))]
    assert (
        distillation.distilled_trees(context, teacher, teacher, late, Cost()) == late
    )  # no time for another


@pytest.mark.slow
def test_fine_tuning_makes_more_of_a_distilled_tree_with_continuous_actions(tmp_path):
    spec = resolve("Pendulum-v1")
    options = {"num_iterations": 3, "episodes_per_iteration": 3, "num_validation_episodes": 3}
    tree = distill(pendulum(), "dagger", max_nodes=7, **options)
    plan = SearchConfig("Pendulum-v1", max_nodes=7, methods=("teacher",), budget="10M steps", teachers=1)
    context = TaskContext(TaskRequest(plan, tmp_path, "teacher", 0, Budget(10e6, 1e9)), spec)
    save_candidates(context.folder / "distilled", [Candidate(tree, "teacher", Cost())], finished=True)
    distillation.run_distillation(context)
    tuned = [
        one.tree for one in load_candidates(context.folder).candidates if one.method == "teacher + fine-tune"
    ]
    better = [one for one in tuned if one.n_nodes == tree.n_nodes][-1]  # at the limit
    returns = make_evaluator(spec, 1000, "validation").play([tree, better], range(512)).returns.mean(axis=1)
    assert returns[1] > returns[0] + 30
