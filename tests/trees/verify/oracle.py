"""What is said of trees as plain structures: written as text for us, as formulas for z3.

z3 knows real numbers and integers, no float32. It need not: every comparison is put as ``x <= c`` or its opposite
with c float32 (found here by bisection over all float32 numbers), and wherever reals meet such comparisons, a
float32 number does: the greatest that is asked for, or infinity. NaN is left to other tests.
"""

from __future__ import annotations

import dataclasses
from fractions import Fraction
from functools import cache
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import z3

from sympol.trees import BoxActions, DecisionTree, MultiDiscreteActions
from sympol.trees.verify import Property, Verdict, equal

from ..samples import ACTIONS, random_grouped_tree, random_tree

_NORMAL, _LARGEST = 0x00800000, 0x7F7FFFFF
_NUMBERS = _LARGEST - _NORMAL + 1

Said = tuple[Any, ...]
"""("and" | "or", parts), ("not", part), ("cmp", position, relation, text), ("is", group, categories),
("option", component, options)."""


class Answer(NamedTuple):
    """What both say."""

    kind: str
    said: str
    ours: tuple[bool, bool]
    """Whether it holds, and whether vacuously."""
    z3: tuple[bool, bool]
    our_seconds: float
    z3_seconds: float


def float32_number(index: int) -> Fraction:
    """Count the finite float32 numbers that are not subnormal, 0 at 0."""
    if index == 0:
        return Fraction(0)
    bits = np.uint32(_NORMAL + abs(index) - 1)
    return Fraction(float(bits.view(np.float32))) * (1 if index > 0 else -1)


@cache
def greatest(number: Fraction, *, below: bool) -> Fraction:
    """Find the greatest float32 number that is at most ``number``, or below it."""
    least, most = -_NUMBERS, _NUMBERS
    while least < most:
        middle = (least + most + 1) // 2
        fits = float32_number(middle) < number if below else float32_number(middle) <= number
        least, most = (middle, most) if fits else (least, middle - 1)
    return float32_number(least)


def random_case(rng: np.random.Generator, *, grouped: bool, depth: int | None = None) -> DecisionTree:
    """Draw a tree of any kind of actions, some of whose features are whole numbers."""
    make = random_grouped_tree if grouped else random_tree
    actions = ACTIONS[rng.choice(list(ACTIONS))]
    tree = make(rng, actions, depth=int(rng.integers(1, 5)) if depth is None else depth)
    free = [f for f in range(tree.n_features) if f not in tree.group_of]
    return dataclasses.replace(tree, integers=[f for f in free if rng.random() < 0.3])


def random_condition(rng: np.random.Generator, tree: DecisionTree, depth: int = 2) -> Said:
    """Draw a condition on features whose numbers are thresholds, near them, and others."""
    if depth and rng.random() < 0.6:
        if rng.random() < 0.3:
            return ("not", random_condition(rng, tree, depth - 1))
        return (
            rng.choice(["and", "or"]),
            [random_condition(rng, tree, depth - 1) for _ in range(rng.integers(2, 4))],
        )
    if tree.groups and rng.random() < 0.5:
        which = int(rng.integers(len(tree.groups)))
        n = len(tree.groups[which].features)
        return ("is", which, sorted(rng.choice(n, rng.integers(1, n + 1), replace=False).tolist()))
    feature = int(rng.integers(tree.n_features))
    asked = tree.threshold[tree.feature == feature]
    return _comparison(rng, feature, [*asked, tree.feature_low[feature], tree.feature_high[feature]])


def random_claim(rng: np.random.Generator, tree: DecisionTree, depth: int = 1) -> Said:
    """Draw a claim about actions."""
    if depth and rng.random() < 0.3:
        return (rng.choice(["and", "or"]), [random_claim(rng, tree, 0) for _ in range(2)])
    if depth and rng.random() < 0.2:
        return ("not", random_claim(rng, tree, 0))
    options = _options(tree)
    component = int(rng.integers(len(options)))
    if isinstance(tree.actions, BoxActions):
        decided = tree.actions.decide(tree.value[tree.is_leaf]).reshape(-1, len(options))
        return _comparison(rng, component, decided[:, component])
    n = len(options[component][1])
    return ("option", component, sorted(rng.choice(n, rng.integers(1, n + 1), replace=False).tolist()))


def _comparison(rng: np.random.Generator, position: int, near: Any) -> Said:
    numbers = [float(x) for x in near if np.isfinite(x)] or [0.0]
    x = rng.choice(numbers)
    text = [
        f"{Fraction(x).limit_denominator(1) if x == int(x) else format(x, '.60g')}",  # exactly that float32
        str(np.float32(x)),  # what is printed for it, mostly another number
        f"{rng.normal():.2f}",
        "1e-40",
        "-1e-40",
        "0",
    ][rng.choice(6, p=[0.4, 0.3, 0.2, 0.03, 0.03, 0.04])]
    return ("cmp", position, str(rng.choice(["<", "<=", ">", ">="])), text)


def _options(tree: DecisionTree) -> list[tuple[str, tuple[str, ...], int]]:
    """Name, options and first number of each component."""
    actions = tree.actions
    if isinstance(actions, BoxActions):
        return [(name, (), 0) for name in actions.names]
    if isinstance(actions, MultiDiscreteActions):
        return list(zip(actions.names, actions.options, actions.start, strict=True))
    return [("action", actions.names, actions.start)]


def as_text(said: Said, tree: DecisionTree, names: tuple[str, ...]) -> str:
    """Write a condition or a claim in the language of rules."""
    match said:
        case ("not", part):
            return f"not ({as_text(part, tree, names)})"
        case ("and" | "or" as join, parts):
            return f" {join} ".join(f"({as_text(part, tree, names)})" for part in parts)
        case ("cmp", position, relation, text):
            return f"{names[position]} {relation} {text}"
        case ("is", which, categories):
            group = tree.groups[which]
            listed = ", ".join(group.categories[i] for i in categories)
            return f"{group.name} is one of {listed}" if len(categories) > 1 else f"{group.name} is {listed}"
        case ("option", component, options):
            name, words, start = _options(tree)[component]
            if len(options) == 1:
                return f"{name} is {start + options[0]}"
            return f"{name} is one of {', '.join(words[i] for i in options)}"
    raise AssertionError(said)


def _at_most(x: Any, text: str, relation: str) -> Any:
    """Put ``x relation number`` as ``x <= c`` or its opposite."""
    cut = greatest(Fraction(text), below=relation in ("<", ">="))
    holds = x <= (z3.Q(cut.numerator, cut.denominator) if isinstance(x, z3.ExprRef) else cut)
    if relation in ("<", "<="):
        return holds
    return z3.Not(holds) if isinstance(holds, z3.ExprRef) else not holds


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
            return _at_most(x[position], text, relation)
        case ("is", which, categories):
            return z3.Or([x[tree.groups[which].features[i]] == 1 for i in categories])
    raise AssertionError(said)


def is_true(said: Said, action: list[Fraction], tree: DecisionTree) -> bool:
    """Whether a claim is true of one action."""
    match said:
        case ("not", part):
            return not is_true(part, action, tree)
        case ("and", parts):
            return all(is_true(part, action, tree) for part in parts)
        case ("or", parts):
            return any(is_true(part, action, tree) for part in parts)
        case ("cmp", position, relation, text):
            return bool(_at_most(action[position], text, relation))
        case ("option", component, options):
            return action[component] - _options(tree)[component][2] in options
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


def _rational(number: float) -> Any:
    fraction = Fraction(float(number))
    return z3.Q(fraction.numerator, fraction.denominator)


def by_leaf(tree: DecisionTree, x: list[Any], leaf_formula: Any, node: int = 0) -> Any:
    """Say what is true of the leaf in which x ends."""
    if tree.is_leaf[node]:
        return leaf_formula(node)
    left, right = (int(children[node]) for children in (tree.children_left, tree.children_right))
    goes_left = x[tree.feature[node]] <= _rational(tree.threshold[node])
    return z3.If(goes_left, by_leaf(tree, x, leaf_formula, left), by_leaf(tree, x, leaf_formula, right))


def decided(tree: DecisionTree, node: int) -> list[Fraction]:
    action = tree.actions.decide(tree.value[node : node + 1])
    return [Fraction(float(number)) for number in np.ravel(action)]


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
    components = tuple(name for name, _, _ in _options(tree))
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
    feature, component = int(rng.choice(free)), int(rng.integers(len(_options(tree))))
    increasing, condition = bool(rng.random() < 0.5), random_condition(rng, tree, depth=1)
    rule = (
        f"when {as_text(condition, tree, tree.feature_names)} then {_options(tree)[component][0]} is "
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
            fraction = decided(tree, leaf)[component]
            return z3.Q(fraction.numerator, fraction.denominator)

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
