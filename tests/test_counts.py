"""Whole numbers with exponents and suffixes, and limits of rules in place of nodes."""

from __future__ import annotations

import pytest

from sympol.cli.arguments import parse
from sympol.cli.distill import Distill
from sympol.cli.pareto import Pareto
from sympol.cli.train import parse_train
from sympol.counts import parse_count
from sympol.search.front.config import SearchConfig


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("200000", 200_000),
        ("200k", 200_000),
        ("200 K", 200_000),
        ("1M", 10**6),
        ("1.5M", 1_500_000),
        ("2G", 2 * 10**9),
        ("1e5", 100_000),
        ("1.23456789e8", 123_456_789),
        ("1e23", 10**23),
        ("9007199254740993", 2**53 + 1),
        ("1,000,000", 10**6),
        ("1_000_000", 10**6),
        ("0.5k", 500),
        ("-3", -3),
        ("4.0", 4),
        ("0", 0),
    ],
)
def test_a_count_is_read_exactly(text: str, number: int):
    assert parse_count(text) == number
    assert type(parse_count(text)) is int


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1.2345k", "must be a whole number, got '1.2345k', which is 1234.5"),
        ("1m", "a million is 1M"),
        ("1e31", "of at most 30 digits"),
        ("1e99999", "must be a whole number"),
        ("10,00", "must be a whole number"),
        ("1k5", "must be a whole number"),
        ("k", "must be a whole number"),
        ("١", "must be a whole number"),
        ("", "must be a whole number"),
    ],
)
def test_what_is_no_count_is_refused_in_one_line(text: str, message: str):
    with pytest.raises(ValueError, match=message) as raised:
        parse_count(text)
    assert "\n" not in str(raised.value)


def test_flags_and_budgets_take_counts():
    given = parse_train(["CartPole-v1", "--total-timesteps", "200k", "--eval-episodes", "1e2"])
    assert (given.config.total_timesteps, given.eval_episodes) == (200_000, 100)
    assert SearchConfig(env="CartPole-v1", budget="1.5M steps").steps == 1_500_000
    assert SearchConfig(env="CartPole-v1", budget="5e6 steps").steps == 5_000_000
    assert SearchConfig(env="CartPole-v1", budget="2,000k steps").steps == 2_000_000
    assert SearchConfig(env="CartPole-v1", budget="1.5m").seconds == 90
    with pytest.raises(ValueError, match="the steps of a budget must be a whole number"):
        SearchConfig(env="CartPole-v1", budget="1.23456k steps")
    with pytest.raises(ValueError, match=r"--total-timesteps.*which is 200\.5"):
        parse_train(["CartPole-v1", "--total-timesteps", "0.2005k"])


def test_rules_are_leaves():
    assert parse_train(["CartPole-v1", "--max-rules", "10"]).config.max_nodes == 19
    assert parse(Pareto, "pareto", ["CartPole-v1", "--max-rules=8"]).max_nodes == 15
    assert parse(Distill, "distill", ["run", "--max_rules", "4"]).max_nodes == 7


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--max-rules", "0"], "--max-rules must be at least 1, got 0"),
        (["--max-rules", "ten"], "--max-rules must be a whole number"),
        (["--max-rules"], "--max-rules must be a whole number"),
        (["--max-rules", "4", "--max-nodes", "7"], "the same limit, nodes = 2 rules - 1: give one"),
    ],
)
def test_limits_of_rules_that_cannot_be(words: list[str], message: str):
    with pytest.raises(ValueError, match=message):
        parse(Pareto, "pareto", ["CartPole-v1", *words])
    with pytest.raises(ValueError, match=message):
        parse_train(["CartPole-v1", *words])
