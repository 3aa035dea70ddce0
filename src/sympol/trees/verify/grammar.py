"""The grammar of rules: a recursive-descent parser from text to `Rule`.

```
rule       when CONDITION then CLAIM  |  CLAIM [when CONDITION]
CONDITION  terms joined by "or", "and", "not" and parentheses
  term     pole angle > 0.1            <, <=, >, >=, =, != and ≤, ≥, ≠
           -0.1 < pole angle <= 0.1
           pole angle between -0.1 and 0.1          both ends included
           front is lava               front is not lava, front is one of lava, wall,
                                       front is neither lava nor wall
           hand of 12                  a feature of a group alone: its category is the one
CLAIM      [never | always] terms joined in the same way, or one monotonicity
  term     action is push right        action is not …, is one of …, is never …, is always …, never is …
           action is 1                 options by number
           steer is left               a component of several, by its name
           torque between -1 and 1     continuous: compared as features are
  alone    torque is increasing in angular velocity   a monotonicity: never falls; decreasing: never rises
```

Names are written as they are, with or without the unit in parentheses at their end; the longest that fits is
meant. A name that would be misread is quoted as in JSON. Numbers are exact: ``x > 0.1`` is true of the float32
numbers greater than one tenth. Nothing in a rule is ever executed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import TypeVar, final

from ...bounded import DEEPEST
from ..actions import ActionSpec, BoxActions, DiscreteActions
from ..base import BaseTree
from ..floats import printable
from ..groups import Group
from ..name_lookup import without_units
from .conditions import ALWAYS, All, Any, Between, Condition, Not, interval
from .scanner import Scanner

ACTION = "action"
"""The name of a discrete action in rules; several components go by their own names."""
_T = TypeVar("_T")


@final
@dataclass(frozen=True)
class Monotone:
    """The claim that a component of the action never falls as a feature rises.

    Args:
        component: Position in the flat action.
        feature: Position in the observation.
        increasing: False for the claim that the component never rises.
    """

    component: int
    feature: int
    increasing: bool


@final
@dataclass(frozen=True)
class Rule:
    """A condition on observations and a claim about the action wherever it holds.

    Args:
        condition: Its positions are those of features.
        claim: Its positions are those of the numbers of a flat action.
    """

    condition: Condition
    claim: Condition | Monotone


def parse_rule(text: str, tree: BaseTree) -> Rule:
    """Parse a rule about the features and actions of a tree.

    Args:
        text: The rule, at most 10,000 characters.
        tree: The tree whose names may occur in it.

    Returns:
        The rule, with every name resolved to a position.

    Raises:
        ValueError: If it is not a rule, or names something that the tree lacks; the message suggests near names.
    """
    return _parse(text, lambda scanner: _rule(scanner, tree))


def parse_condition(text: str, tree: BaseTree) -> Condition:
    """Parse a condition on the features of a tree: the part of a rule after ``when``.

    Args:
        text: The condition, at most 10,000 characters.
        tree: The tree whose names may occur in it.

    Returns:
        The condition, with every name resolved to the position of a feature.

    Raises:
        ValueError: If it is not a condition, or names something that the tree lacks.
    """
    return _parse(text, lambda scanner: _joined(scanner, lambda: _feature_term(scanner, tree)))


def _parse(text: str, read: Callable[[Scanner], _T]) -> _T:
    scanner = Scanner(text)
    found = read(scanner)
    if not scanner.at_end():
        scanner.fail("expected the end of the rule, or 'and' or 'or'")
    return found


def _rule(scanner: Scanner, tree: BaseTree) -> Rule:
    def condition() -> Condition:
        return _joined(scanner, lambda: _feature_term(scanner, tree))

    if scanner.take_word("when"):
        before = condition()
        if not scanner.take_word("then"):
            scanner.fail("expected 'and', 'or' or 'then'")
        return Rule(before, _claim(scanner, tree))
    claim = _claim(scanner, tree)
    return Rule(condition() if scanner.take_word("when") else ALWAYS, claim)


def _claim(scanner: Scanner, tree: BaseTree) -> Condition | Monotone:
    monotone: list[Monotone] = []

    def term() -> Condition:
        claim = _action_term(scanner, tree)
        if isinstance(claim, Monotone):
            monotone.append(claim)
            return ALWAYS
        return claim

    never = scanner.take_word("never", "always") == "never"
    joined = _joined(scanner, term)
    if not monotone:
        return Not(joined) if never else joined
    if joined != ALWAYS or never:
        scanner.fail("a monotonicity is a claim of its own, without 'and', 'or', 'not' and 'never'")
    return monotone[0]


def _joined(scanner: Scanner, term: Callable[[], Condition]) -> Condition:
    """Parse terms joined by ``or``, ``and``, ``not`` and parentheses, which bind in this order."""

    def disjunction() -> Condition:
        parts = [conjunction()]
        while scanner.take_word("or"):
            parts.append(conjunction())
        return parts[0] if len(parts) == 1 else Any(tuple(parts))

    def conjunction() -> Condition:
        parts = [factor()]
        while scanner.take_word("and"):
            parts.append(factor())
        return parts[0] if len(parts) == 1 else All(tuple(parts))

    depth = 0

    def factor() -> Condition:
        nonlocal depth
        negated = scanner.take_word("not")
        if not negated and not scanner.take_sign("("):
            return term()
        depth += 1
        if depth > DEEPEST:
            raise ValueError(
                f"the rule nests too deeply: more than {DEEPEST} 'not' and '(' within each other"
            )
        inner = factor() if negated else disjunction()
        if not negated and not scanner.take_sign(")"):
            scanner.fail("expected ')'")
        depth -= 1
        return Not(inner) if negated else inner

    return disjunction()


# ---- terms about features and groups ----


def _feature_term(scanner: Scanner, tree: BaseTree) -> Condition:
    groups = tuple(group.name for group in tree.groups if group.name)
    names = (*tree.feature_names, *groups)
    name = _take_name(scanner, names)
    if name is None:
        number = scanner.take_number()
        if number is None:
            scanner.fail_unknown_name(names, "feature")
        return _comparison_after_number(scanner, number, tree.feature_names, "feature")
    if name in groups and (name not in tree.feature_names or not scanner.at_relation()):
        _only_position(scanner, name, groups, "groups")
        return _group_term(scanner, next(group for group in tree.groups if group.name == name))
    feature = _only_position(scanner, name, tree.feature_names, "features")
    if (comparison := _comparison(scanner, feature)) is not None:
        return comparison
    if feature in tree.group_of:
        return _is_one(feature)
    if scanner.take_word("is"):
        negated, number = scanner.take_word("not"), scanner.take_number()
        if number is not None:
            equal = _equal(scanner, feature, number)
            return Not(equal) if negated else equal
    scanner.fail(f"expected a comparison of {printable(name)!r}, such as '> 0.1' or 'between 0 and 1'")


def _group_term(scanner: Scanner, group: Group) -> Condition:
    def category() -> Condition:
        name = scanner.take_name(group.categories)
        if name is None:
            scanner.fail_unknown_name(group.categories, "category")
        return _is_one(group.features[_only_position(scanner, name, group.categories, "categories")])

    if not scanner.take_word("is"):
        scanner.fail(f"expected 'is' and a category, such as {printable(group.categories[0])!r}")
    if scanner.take_word("neither"):
        parts = [category()]
        while scanner.take_sign(",") or scanner.take_word("nor"):
            parts.append(category())
        return Not(Any(tuple(parts)))
    negated = scanner.take_word("not")
    chosen = _one_of(scanner, category)
    return Not(chosen) if negated else chosen


def _is_one(feature: int) -> Condition:
    # the features of a group are 0 or 1
    return Between(feature, 1.0, float("inf"))


# ---- terms about actions ----


def _action_term(scanner: Scanner, tree: BaseTree) -> Condition | Monotone:
    actions, names = tree.actions, _component_names(tree.actions)
    name = _take_name(scanner, names)
    if name is None:
        number = scanner.take_number() if isinstance(actions, BoxActions) else None
        if number is not None:
            return _comparison_after_number(scanner, number, names, "action")
        if (feature := _take_name(scanner, tree.feature_names)) is not None:
            known = ", ".join(repr(printable(name)) for name in names)
            scanner.fail(
                f"a claim is about actions ({known}), but {printable(feature)!r} is a feature: move it to the "
                "condition after 'when'"
            )
        scanner.fail_unknown_name(names, "action")
    component = _only_position(scanner, name, names, "components of the action")
    if not isinstance(actions, BoxActions):
        return _option_term(scanner, tree, component)
    if (comparison := _comparison(scanner, component)) is not None:
        return comparison
    direction = scanner.take_word("increasing", "decreasing") if scanner.take_word("is") else None
    if direction is None:
        scanner.fail(f"expected a comparison of {printable(name)!r}, or 'is increasing in' a feature")
    return _monotone(scanner, tree, component, direction)


def _component_names(actions: ActionSpec) -> tuple[str, ...]:
    return (ACTION,) if isinstance(actions, DiscreteActions) else actions.names


def _option_term(scanner: Scanner, tree: BaseTree, component: int) -> Condition | Monotone:
    actions = tree.actions
    assert not isinstance(actions, BoxActions)
    discrete = isinstance(actions, DiscreteActions)
    options = actions.names if discrete else actions.options[component]
    start = actions.start if discrete else actions.start[component]
    verbs = {word for _ in range(2) if (word := scanner.take_word("is", "never", "always", "not"))}
    if not verbs:
        scanner.fail(f"expected 'is' and an action, such as {printable(options[0])!r}")
    direction = scanner.take_word("increasing", "decreasing")
    if direction is not None:
        return _monotone(scanner, tree, component, direction)

    def option() -> Condition:
        name, last = scanner.take_name(options), start + len(options) - 1
        if name is not None:
            chosen = start + _only_position(scanner, name, options, "actions")
            return Between(component, chosen, chosen)
        number = scanner.take_number()
        if number is None:
            scanner.fail_unknown_name(options, "action")
        if number != int(number) or not start <= number <= last:
            scanner.fail(f"the number of an action is from {start} to {last}, got {number}")
        return Between(component, int(number), int(number))

    chosen = _one_of(scanner, option)
    return Not(chosen) if {"never", "not"} & verbs else chosen


def _monotone(scanner: Scanner, tree: BaseTree, component: int, direction: str) -> Monotone:
    if not scanner.take_word("in"):
        scanner.fail(f"expected 'in' and the name of a feature after {direction!r}")
    if (name := _take_name(scanner, tree.feature_names)) is None:
        scanner.fail_unknown_name(tree.feature_names, "feature")
    feature = _only_position(scanner, name, tree.feature_names, "features")
    if feature in tree.group_of:
        scanner.fail(
            f"{printable(name)!r} is of a group, of which exactly one feature is 1: it cannot change alone, and there "
            "is no order among categories; say which action each category has"
        )
    return Monotone(component, feature, direction == "increasing")


# ---- comparisons and names ----


def _one_of(scanner: Scanner, item: Callable[[], Condition]) -> Condition:
    if not scanner.take_word("one"):
        return item()
    if not scanner.take_word("of"):
        scanner.fail("expected 'of' after 'one'")
    parts = [item()]
    while scanner.take_sign(","):
        parts.append(item())
    return Any(tuple(parts))


def _comparison(scanner: Scanner, position: int) -> Condition | None:
    """Parse what may follow a name: a relation and a number, or ``between`` two numbers."""
    relation = scanner.take_relation()
    if relation is not None:
        return _related(scanner, position, relation, _number(scanner))
    if not scanner.take_word("between"):
        return None
    low = _number(scanner)
    if not scanner.take_word("and"):
        scanner.fail("expected 'and' and a number after 'between'")
    return Between(position, interval(">=", low)[0], interval("<=", _number(scanner))[1])


def _comparison_after_number(scanner: Scanner, number: Decimal, names: Sequence[str], kind: str) -> Condition:
    """Parse what may follow a number: ``< x``, or ``< x <= 2``."""
    relation = scanner.take_relation()
    if relation is None:
        scanner.fail(f"expected '<', '<=', '>' or '>=' after {number}")
    if (name := _take_name(scanner, names)) is None:
        scanner.fail_unknown_name(names, kind)
    position = _only_position(scanner, name, names, f"{kind}s")
    reversed_relation = relation.translate(str.maketrans("<>", "><"))
    first = _related(scanner, position, reversed_relation, number)
    relation = scanner.take_relation()
    if relation is None:
        return first
    return All((first, _related(scanner, position, relation, _number(scanner))))


def _related(scanner: Scanner, position: int, relation: str, number: Decimal) -> Condition:
    if relation in ("=", "!="):
        equal = _equal(scanner, position, number)
        return equal if relation == "=" else Not(equal)
    return Between(position, *interval(relation, number))


def _equal(scanner: Scanner, position: int, number: Decimal) -> Condition:
    low, high = interval("=", number)
    if low > high:
        scanner.fail(
            f"no float32 number is {number}, the nearest are {high!r} and {low!r}; give an interval with 'between'"
        )
    return Between(position, low, high)


def _number(scanner: Scanner) -> Decimal:
    number = scanner.take_number()
    return scanner.fail("expected a number") if number is None else number


def _take_name(scanner: Scanner, names: Sequence[str]) -> str | None:
    """Take a name, in full or without the unit in parentheses at its end."""
    short = without_units(names)
    taken = scanner.take_name((*names, *short))
    return None if taken is None else short.get(taken, taken)


def _only_position(scanner: Scanner, name: str, names: Sequence[str], kind: str) -> int:
    """Return the position of a name that only one of them has."""
    if names.count(name) > 1:
        scanner.fail(f"{names.count(name)} {kind} are called {printable(name)!r}: give them different names")
    return names.index(name)
