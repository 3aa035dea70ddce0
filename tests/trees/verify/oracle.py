"""What is said of trees as formulas for z3, the oracle.

z3 knows real numbers and integers, no float32. It need not: every comparison is put as ``x <= c`` or its opposite
with c float32 (found here by bisection over all float32 numbers), and wherever reals meet such comparisons, a
float32 number does: the greatest that is asked for, or infinity. NaN is left to other tests.
"""

from __future__ import annotations

import dataclasses
from fractions import Fraction
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import z3

from sympol.trees import DecisionTree
from sympol.trees.verify import Property, Verdict, equal

from .questions import (
    Said,
    as_text,
    decided,
    greatest,
    is_true,
    options_of,
    random_case,
    random_claim,
    random_condition,
)


class Answer(NamedTuple):
    """What both say."""

    kind: str
    said: str
    ours: tuple[bool, bool]
    """Whether it holds, and whether vacuously."""
    z3: tuple[bool, bool]
    our_seconds: float
    z3_seconds: float


def _compared(x: Any, relation: str, text: str) -> Any:
    """Put ``x relation number`` as ``x <= c`` or its opposite."""
    at_most = x <= _rational(greatest(Fraction(text), below=relation in ("<", ">=")))
    return at_most if relation in ("<", "<=") else z3.Not(at_most)


def as_formula(said: Said, x: list[Any], tree: DecisionTree) -> Any:
    """Write a condition as a formula over the features x."""
    match said:
        case ("not", part):
            return z3.Not(as_formula(part, x, tree))
        case ("and", parts):
            return z3.And([as_formula(part, x, tree) for part in parts])
        case ("or", parts):
            return z3.Or([as_formula(part, x, tree) for part in parts])
        case ("cmp", position, relation, text):
            return _compared(x[position], relation, text)
        case ("is", which, categories):
            return z3.Or([x[tree.groups[which].features[i]] == 1 for i in categories])
    raise AssertionError(said)


def features(tree: DecisionTree, name: str) -> list[Any]:
    whole = {*tree.integers, *tree.group_of}
    return [(z3.Int if f in whole else z3.Real)(f"{name}{f}") for f in range(tree.n_features)]


def in_space(tree: DecisionTree, x: list[Any], *, bounds: bool) -> Any:
    """Say that x is an observation."""
    parts: list[Any] = []
    limited = set(range(tree.n_features)) if bounds else set()
    for group in tree.groups:
        parts += [z3.Or(x[f] == 0, x[f] == 1) for f in group.features]
        parts.append(z3.Sum([x[f] for f in group.features]) == 1)
        of_group = list(group.features)
        fits = [
            ((tree.feature_low[of_group] <= hot) & (hot <= tree.feature_high[of_group])).all()
            for hot in np.eye(len(of_group))
        ]
        if not any(fits):  # such bounds say nothing, as for prune
            limited -= set(of_group)
    for f in sorted(limited):
        if np.isfinite(tree.feature_low[f]):
            parts.append(x[f] >= _rational(tree.feature_low[f]))
        if np.isfinite(tree.feature_high[f]):
            parts.append(x[f] <= _rational(tree.feature_high[f]))
    return z3.And(parts)


def _rational(number: float | Fraction) -> Any:
    fraction = Fraction(number) if isinstance(number, Fraction) else Fraction(float(number))
    return z3.Q(fraction.numerator, fraction.denominator)


def by_leaf(tree: DecisionTree, x: list[Any], leaf_formula: Any, node: int = 0) -> Any:
    """Say what is true of the leaf in which x ends."""
    if tree.is_leaf[node]:
        return leaf_formula(node)
    left, right = (int(children[node]) for children in (tree.children_left, tree.children_right))
    goes_left = x[tree.feature[node]] <= _rational(tree.threshold[node])
    return z3.If(goes_left, by_leaf(tree, x, leaf_formula, left), by_leaf(tree, x, leaf_formula, right))


def _can_be(*formulas: Any) -> bool:
    solver = z3.SimpleSolver()
    solver.add(*formulas)
    found = solver.check()
    assert found != z3.unknown
    return found == z3.sat


def _verdict(verdict: Verdict) -> tuple[bool, bool]:
    return verdict.holds, verdict.vacuous


def ask_rule(rng: np.random.Generator, tree: DecisionTree) -> Answer:
    """Ask both for a random rule."""
    condition, claim, bounds = random_condition(rng, tree), random_claim(rng, tree), bool(rng.random() < 0.7)
    components = tuple(name for name, _, _ in options_of(tree))
    rule = f"when {as_text(condition, tree, tree.feature_names)} then {as_text(claim, tree, components)}"
    start = perf_counter()
    (ours,) = tree.verify(Property(rule, within_bounds=bounds))
    middle = perf_counter()
    x = features(tree, "x")
    given = z3.And(in_space(tree, x, bounds=bounds), as_formula(condition, x, tree))
    wrong = by_leaf(tree, x, lambda leaf: z3.BoolVal(not is_true(claim, decided(tree, leaf), tree)))
    theirs = (not _can_be(given, wrong), not _can_be(given))
    return Answer("rule", rule, _verdict(ours), theirs, middle - start, perf_counter() - middle)


def ask_monotone(rng: np.random.Generator, tree: DecisionTree) -> Answer:
    """Ask both whether an action rises, or falls, with a feature, where a condition holds."""
    free = [f for f in range(tree.n_features) if f not in tree.group_of]
    feature, component = int(rng.choice(free)), int(rng.integers(len(options_of(tree))))
    increasing, condition = bool(rng.random() < 0.5), random_condition(rng, tree, depth=1)
    rule = (
        f"when {as_text(condition, tree, tree.feature_names)} then {options_of(tree)[component][0]} is "
        f"{'increasing' if increasing else 'decreasing'} in {tree.feature_names[feature]}"
    )
    start = perf_counter()
    (ours,) = tree.verify(rule)
    middle = perf_counter()
    x, other = features(tree, "x"), features(tree, "y")
    y = [other[f] if f == feature else x[f] for f in range(tree.n_features)]
    given = [z3.And(in_space(tree, z, bounds=True), as_formula(condition, z, tree)) for z in (x, y)]

    def action(z: list[Any]) -> Any:
        def number(leaf: int) -> Any:
            return _rational(decided(tree, leaf)[component])

        return by_leaf(tree, z, number)

    wrong = action(x) > action(y) if increasing else action(x) < action(y)
    theirs = (not _can_be(*given, x[feature] <= y[feature], wrong), not _can_be(given[0]))
    return Answer("monotone", rule, _verdict(ours), theirs, middle - start, perf_counter() - middle)


def ask_equal(rng: np.random.Generator, tree: DecisionTree) -> Answer:
    """Ask both whether a tree is its pruned self, and whether it still is after a small change."""
    other, bounds = tree.prune(bounds=bool(rng.random() < 0.7)), bool(rng.random() < 0.7)
    leaves = np.flatnonzero(other.is_leaf)
    if rng.random() < 0.5:
        value = other.value.copy()
        value[rng.choice(leaves)] = tree.value[rng.choice(np.flatnonzero(tree.is_leaf))]
        other = dataclasses.replace(other, value=value)
    start = perf_counter()
    ours = equal(tree, other, within_bounds=bounds)
    middle = perf_counter()
    x = features(tree, "x")
    given = in_space(tree, x, bounds=bounds)
    wrong = by_leaf(
        tree,
        x,
        lambda one: by_leaf(other, x, lambda two: z3.BoolVal(decided(tree, one) != decided(other, two))),
    )
    theirs = (not _can_be(given, wrong), not _can_be(given))
    return Answer("equal", "", _verdict(ours), theirs, middle - start, perf_counter() - middle)


def ask(rng: np.random.Generator, *, grouped: bool) -> Answer:
    """Ask both something about a random tree."""
    tree = random_case(rng, grouped=grouped)
    question = rng.choice([ask_rule, ask_monotone, ask_equal], p=[0.7, 0.15, 0.15])
    return question(rng, tree)
