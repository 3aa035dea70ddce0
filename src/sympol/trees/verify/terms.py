"""The terms of rules: what they may say of a feature, a group, and an action."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import final

from ..actions import ActionSpec, BoxActions, DiscreteActions
from ..base import BaseTree
from ..floats import printable
from ..groups import Group
from .logic import All, Any, Between, Condition, Not
from .names import without_units
from .numbers import interval
from .scanner import Scanner

ACTION = "action"
"""What a discrete action is called; those with several components call them by name."""


@final
@dataclass(frozen=True)
class Monotone:
    """A component of the action never falls as a feature rises; or never rises, where ``increasing`` is false."""

    component: int
    feature: int
    increasing: bool


def component_names(actions: ActionSpec) -> tuple[str, ...]:
    """What the numbers of an action are called in rules."""
    return (ACTION,) if isinstance(actions, DiscreteActions) else actions.names


def about_features(scanner: Scanner, tree: BaseTree) -> Condition:
    """Read one term of a condition. Raises ValueError if it is none."""
    groups = tuple(group.name for group in tree.groups if group.name)
    names = (*tree.feature_names, *groups)
    name = _name(scanner, names)
    if name is None:
        number = scanner.number()
        if number is None:
            scanner.fail_at_name(names, "feature")
        return _number_first(scanner, number, tree.feature_names, "feature")
    if name in groups and (name not in tree.feature_names or not scanner.stands_relation()):
        _only(scanner, name, groups, "groups")
        return _about_group(scanner, next(group for group in tree.groups if group.name == name))
    feature = _only(scanner, name, tree.feature_names, "features")
    if (compared := _compared(scanner, feature)) is not None:
        return compared
    if feature in tree.group_of:
        return _is_one(feature)
    if scanner.word("is"):
        negated, number = scanner.word("not"), scanner.number()
        if number is not None:
            equal = _equal(scanner, feature, number)
            return Not(equal) if negated else equal
    scanner.fail(f"expected a comparison of {printable(name)!r}, such as '> 0.1' or 'between 0 and 1'")


def about_actions(scanner: Scanner, tree: BaseTree) -> Condition | Monotone:
    """Read one term of a claim. Raises ValueError if it is none."""
    actions, names = tree.actions, component_names(tree.actions)
    name = _name(scanner, names)
    if name is None:
        number = scanner.number() if isinstance(actions, BoxActions) else None
        if number is not None:
            return _number_first(scanner, number, names, "action")
        if (feature := _name(scanner, tree.feature_names)) is not None:
            scanner.fail(
                f"a claim is about actions ({_quoted(names)}), but {printable(feature)!r} is a feature: "
                "what is said of features stands behind 'when'"
            )
        scanner.fail_at_name(names, "action")
    component = _only(scanner, name, names, "components of the action")
    if not isinstance(actions, BoxActions):
        return _about_options(scanner, tree, component)
    if (compared := _compared(scanner, component)) is not None:
        return compared
    direction = scanner.word("increasing", "decreasing") if scanner.word("is") else None
    if direction is None:
        scanner.fail(f"expected a comparison of {printable(name)!r}, or 'is increasing in' a feature")
    return _monotone(scanner, tree, component, direction)


def _about_options(scanner: Scanner, tree: BaseTree, component: int) -> Condition | Monotone:
    actions = tree.actions
    assert not isinstance(actions, BoxActions)
    discrete = isinstance(actions, DiscreteActions)
    options = actions.names if discrete else actions.options[component]
    start = actions.start if discrete else actions.start[component]
    said = {word for _ in range(2) if (word := scanner.word("is", "never", "always", "not"))}
    if not said:
        scanner.fail(f"expected 'is' and an action, such as {printable(options[0])!r}")
    direction = scanner.word("increasing", "decreasing")
    if direction is not None:
        return _monotone(scanner, tree, component, direction)

    def option() -> Condition:
        name, last = scanner.name(options), start + len(options) - 1
        if name is not None:
            chosen = start + _only(scanner, name, options, "actions")
            return Between(component, chosen, chosen)
        number = scanner.number()
        if number is None:
            scanner.fail_at_name(options, "action")
        if number != int(number) or not start <= number <= last:
            scanner.fail(f"the number of an action is from {start} to {last}, got {number}")
        return Between(component, int(number), int(number))

    chosen = _one_of(scanner, option)
    return Not(chosen) if {"never", "not"} & said else chosen


def _monotone(scanner: Scanner, tree: BaseTree, component: int, direction: str) -> Monotone:
    if not scanner.word("in"):
        scanner.fail(f"expected 'in' and the name of a feature after {direction!r}")
    if (name := _name(scanner, tree.feature_names)) is None:
        scanner.fail_at_name(tree.feature_names, "feature")
    feature = _only(scanner, name, tree.feature_names, "features")
    if feature in tree.group_of:
        scanner.fail(
            f"{printable(name)!r} is of a group, of which exactly one feature is 1: it cannot change alone, and there "
            "is no order among categories; say which action each category has"
        )
    return Monotone(component, feature, direction == "increasing")


def _about_group(scanner: Scanner, group: Group) -> Condition:
    def category() -> Condition:
        name = scanner.name(group.categories)
        if name is None:
            scanner.fail_at_name(group.categories, "category")
        return _is_one(group.features[_only(scanner, name, group.categories, "categories")])

    if not scanner.word("is"):
        scanner.fail(f"expected 'is' and a category, such as {printable(group.categories[0])!r}")
    if scanner.word("neither"):
        parts = [category()]
        while scanner.sign(",") or scanner.word("nor"):
            parts.append(category())
        return Not(Any(tuple(parts)))
    negated = scanner.word("not")
    chosen = _one_of(scanner, category)
    return Not(chosen) if negated else chosen


def _one_of(scanner: Scanner, item: Callable[[], Condition]) -> Condition:
    if not scanner.word("one"):
        return item()
    if not scanner.word("of"):
        scanner.fail("expected 'of' after 'one'")
    parts = [item()]
    while scanner.sign(","):
        parts.append(item())
    return Any(tuple(parts))


def _is_one(feature: int) -> Condition:
    # features of a group are 0 or 1
    return Between(feature, 1.0, float("inf"))


def _compared(scanner: Scanner, position: int) -> Condition | None:
    """What follows a name: a relation and a number, or two numbers to be between."""
    relation = scanner.relation()
    if relation is not None:
        return _related(scanner, position, relation, _number(scanner))
    if not scanner.word("between"):
        return None
    low = _number(scanner)
    if not scanner.word("and"):
        scanner.fail("expected 'and' and a number after 'between'")
    return Between(position, interval(">=", low)[0], interval("<=", _number(scanner))[1])


def _number_first(scanner: Scanner, number: Decimal, names: Sequence[str], what: str) -> Condition:
    """What follows a number: ``< x``, or ``< x <= 2``."""
    relation = scanner.relation()
    if relation is None:
        scanner.fail(f"expected '<', '<=', '>' or '>=' after {number}")
    if (name := _name(scanner, names)) is None:
        scanner.fail_at_name(names, what)
    position = _only(scanner, name, names, f"{what}s")
    turned = relation.translate(str.maketrans("<>", "><"))
    first = _related(scanner, position, turned, number)
    relation = scanner.relation()
    return (
        first if relation is None else All((first, _related(scanner, position, relation, _number(scanner))))
    )


def _related(scanner: Scanner, position: int, relation: str, number: Decimal) -> Condition:
    if relation in ("=", "!="):
        equal = _equal(scanner, position, number)
        return equal if relation == "=" else Not(equal)
    return Between(position, *interval(relation, number))


def _equal(scanner: Scanner, position: int, number: Decimal) -> Condition:
    low, high = interval("=", number)
    if low > high:
        scanner.fail(
            f"no float32 number is {number}, the nearest are {high!r} and {low!r}; write from where to where"
        )
    return Between(position, low, high)


def _number(scanner: Scanner) -> Decimal:
    number = scanner.number()
    return scanner.fail("expected a number") if number is None else number


def _name(scanner: Scanner, names: Sequence[str]) -> str | None:
    """Take a name, in full or without the unit in parentheses that it ends in, where that is no other's name."""
    short = without_units(names)
    taken = scanner.name((*names, *short))
    return None if taken is None else short.get(taken, taken)


def _only(scanner: Scanner, name: str, names: Sequence[str], what: str) -> int:
    """Return where the only one of this name is."""
    if names.count(name) > 1:
        scanner.fail(f"{names.count(name)} {what} are called {printable(name)!r}: give them different names")
    return names.index(name)


def _quoted(names: Sequence[str]) -> str:
    return ", ".join(repr(printable(name)) for name in names)
