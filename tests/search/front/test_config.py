"""The configuration of a search."""

from __future__ import annotations

import json
import math
import re

import pytest

from sympol.algorithms.presets import search_defaults
from sympol.results.records import from_fields, to_fields
from sympol.search.front.config import SELECTION, SHARES, SearchConfig


@pytest.mark.parametrize(
    ("budget", "seconds", "steps"),
    [
        ("90s", 90, math.inf),
        ("5m", 300, math.inf),
        ("1.5h", 5400, math.inf),
        ("2000000 steps", math.inf, 2e6),
        ("50M steps", math.inf, 5e7),
        ("2 G steps", math.inf, 2e9),
    ],
)
def test_a_budget_is_a_time_or_steps(budget, seconds, steps):
    plan = SearchConfig("CartPole-v1", budget=budget)
    assert (plan.seconds, plan.steps) == (seconds, steps)


@pytest.mark.parametrize("budget", ["5", "5 minutes", "0s", "-3m", "many steps", "nan s"])
def test_what_is_no_budget_is_refused_with_examples(budget):
    with pytest.raises(ValueError, match="90s, 5m or 1h, or environment steps"):
        SearchConfig("CartPole-v1", budget=budget)


@pytest.mark.parametrize(
    ("budget", "methods"), [("9s", ("evolve",)), ("99k steps", ("evolve",)), ("400k steps", tuple(SHARES))]
)
def test_too_little_for_one_run_is_refused_with_what_is_enough(budget, methods):
    with pytest.raises(ValueError, match=r"too small for one run.*at least 10s or \d+k steps") as refused:
        SearchConfig("CartPole-v1", budget=budget, methods=methods)
    enough = re.search(r"or (\d+k steps)", str(refused.value))[1]
    assert SearchConfig("CartPole-v1", budget=enough, methods=methods).methods == methods


def test_a_task_has_a_budget_of_its_own():
    assert SearchConfig("CartPole-v1").seconds == 120
    assert SearchConfig("LunarLander-v3").seconds == 1800
    assert SearchConfig("Anything-v0").seconds == 600


def test_a_task_has_a_number_of_teachers_unless_one_is_given():
    assert SearchConfig("LunarLander-v3").teachers == 4
    assert SearchConfig("Anything-v0").teachers == 2
    assert SearchConfig("LunarLander-v3", teachers=1).teachers == 1


@pytest.mark.parametrize("env", ["CartPole-v1", "LunarLander-v3"])
@pytest.mark.parametrize("methods", [("scratch",), ("scratch", "evolve"), tuple(SHARES)])
def test_methods_share_all_but_what_selection_takes(env, methods):
    plan = SearchConfig(env, methods=methods)
    assert sum(plan.share(method) for method in methods) == pytest.approx(1 - SELECTION)


def test_each_task_divides_its_budget_among_all_methods():
    assert search_defaults("LunarLander-v3")["shares"].keys() == SHARES.keys()


@pytest.mark.parametrize(("limit", "remedy"), [(8, "7 or 9"), (0, "1 or 3"), (-3, "1 or 3")])
def test_trees_have_odd_sizes(limit, remedy):
    with pytest.raises(ValueError, match=f"odd and at least 1, got {limit}.*give {remedy}"):
        SearchConfig("CartPole-v1", max_nodes=limit)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"methods": ()}, "got none"),
        ({"methods": ("scratch", "magic")}, "got scratch, magic"),
        ({"trainings": 0}, "trainings must be at least 1, got 0"),
        ({"teachers": 0}, "teachers must be at least 1"),
        ({"islands": 0}, "islands must be at least 1"),
        ({"eval_episodes": 1}, "at least 2"),
    ],
)
def test_other_bad_input(wrong, words):
    with pytest.raises(ValueError, match=words):
        SearchConfig("CartPole-v1", **wrong)


def test_it_goes_through_json():
    plan = SearchConfig("CartPole-v1", {"size": 3}, seed=4, max_nodes=9, methods=("evolve",), budget="3m")
    assert from_fields(SearchConfig, json.loads(json.dumps(to_fields(plan)))) == plan
    with pytest.raises(ValueError, match="unknown fields speed"):
        from_fields(SearchConfig, {**to_fields(plan), "speed": 3})
    former = to_fields(plan)
    former["roads"] = former.pop("methods")  # as an earlier version named them
    assert from_fields(SearchConfig, former) == plan
