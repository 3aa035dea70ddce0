"""What can be asked about trees, drawn at random: plain structures, written as text, and true of actions or not."""

from __future__ import annotations

import dataclasses
from fractions import Fraction
from functools import cache
from itertools import product
from typing import Any

import numpy as np

from sympol.trees import BoxActions, DecisionTree, MultiDiscreteActions
from sympol.trees.floats import next_above

from ..samples import ACTIONS, consistent, random_grouped_tree, random_tree

_NORMAL, _LARGEST = 0x00800000, 0x7F7FFFFF
_NUMBERS = _LARGEST - _NORMAL + 1

Said = tuple[Any, ...]
"""("and" | "or", parts), ("not", part), ("cmp", position, relation, text), ("is", group, categories),
("option", component, options)."""


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
    options = options_of(tree)
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


def options_of(tree: DecisionTree) -> list[tuple[str, tuple[str, ...], int]]:
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
            name, words, start = options_of(tree)[component]
            if len(options) == 1:
                return f"{name} is {start + options[0]}"
            return f"{name} is one of {', '.join(words[i] for i in options)}"
    raise AssertionError(said)


def compared(number: Fraction, relation: str, text: str) -> bool:
    """Compare a float32 number with a decimal one."""
    at_most = number <= greatest(Fraction(text), below=relation in ("<", ">="))
    return at_most == (relation in ("<", "<="))


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
            return compared(action[position], relation, text)
        case ("option", component, options):
            return action[component] - options_of(tree)[component][2] in options
    raise AssertionError(said)


def decided(tree: DecisionTree, node: int) -> list[Fraction]:
    action = tree.actions.decide(tree.value[node : node + 1])
    return [Fraction(float(number)) for number in np.ravel(action)]


def literals(said: Said, feature: int) -> list[float]:
    """The float32 numbers at which a condition's comparisons of a feature change."""
    match said:
        case ("not", part):
            return literals(part, feature)
        case ("and" | "or", parts):
            return [number for part in parts for number in literals(part, feature)]
        case ("cmp", position, relation, text) if position == feature:
            return [float(greatest(Fraction(text), below=relation in ("<", ">=")))]
    return []


def every_kind_of_observation(tree: DecisionTree, *conditions: Said) -> np.ndarray:
    """One observation at least for each set of answers to all questions of a tree and of conditions."""
    axes = []
    for f in range(tree.n_features):
        if f in tree.group_of:
            axes.append(np.float32([0, 1]))
            continue
        cuts = np.float32([number for said in conditions for number in literals(said, f)])
        cuts = np.concatenate([cuts, tree.threshold[tree.feature == f]])
        ends = [tree.feature_low[f], tree.feature_high[f], 0, -np.inf, np.inf, np.nan]
        if f in tree.integers:
            cuts, ends = np.floor(np.concatenate([cuts, tree.feature_high[[f]]])), [0]
            cuts = np.concatenate([cuts, cuts + 1, np.ceil(tree.feature_low[[f]]), [-9, 9]])
            axes.append(np.unique(cuts[np.isfinite(cuts)]).astype(np.float32) + np.float32(0))
            continue
        axes.append(np.unique(np.concatenate([cuts, next_above(cuts), np.float32(ends)])))
    return consistent(tree, np.array(list(product(*axes)), np.float32))


def truth(said: Said, x: np.ndarray, tree: DecisionTree, *, negated: bool = False) -> bool:
    """Whether a condition, or its opposite, is true of an observation."""
    match said:
        case ("not", part):
            return truth(part, x, tree, negated=not negated)
        case ("and" | "or" as join, parts):
            each = [truth(part, x, tree, negated=negated) for part in parts]
            return all(each) if (join == "and") != negated else any(each)
        case ("is", which, categories):
            return any(x[tree.groups[which].features[i]] == 1 for i in categories) != negated
        case ("cmp", position, relation, text):
            # where a number is NaN, neither a comparison nor its opposite is true
            number = float(x[position])
            if np.isinf(number):
                return ((number > 0) == (relation in (">", ">="))) != negated
            return not np.isnan(number) and compared(Fraction(number), relation, text) != negated
    raise AssertionError(said)
