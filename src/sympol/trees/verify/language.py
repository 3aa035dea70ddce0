"""The language of rules, read by hand: text in, `Rule` out; nothing in it is ever run.

```
rule       when CONDITION then CLAIM  |  CLAIM [when CONDITION]
CONDITION  terms joined by "or", "and", "not" and parentheses
  term     pole angle > 0.1            <, <=, >, >=, =, != and ≤, ≥, ≠
           -0.1 < pole angle <= 0.1
           pole angle between -0.1 and 0.1          both ends included
           front is lava               front is not lava, front is one of lava, wall,
                                       front is neither lava nor wall
           hand of 12                  a feature of a group alone: it is the one
CLAIM      [never | always] terms joined likewise, or one monotonicity
  term     action is push right        action is not …, is one of …, is never …, is always …, never is …
           action is 1                 options by number
           steer is left               a component of several, by its name
           torque between -1 and 1     continuous: compared as features are
  alone    torque is increasing in angular velocity   a monotonicity: never falls; or decreasing: never rises
```

Names stand as they are, the longest that fits, with or without the unit in parentheses that they end in; in
quotes, as in JSON, where they contain what would be misread.
Numbers are exact: ``x > 0.1`` is true of the float32 numbers that are greater than one tenth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar, final

from ...bounded import DEEPEST
from ..base import BaseTree
from .logic import ALWAYS, All, Any, Condition, Not
from .scanner import Scanner
from .terms import Monotone, about_actions, about_features

_T = TypeVar("_T")


@final
@dataclass(frozen=True)
class Rule:
    """Whenever the condition is true of an observation, the claim is true of the action.

    Positions in a condition are features, those in a claim the numbers of an action.
    """

    condition: Condition
    claim: Condition | Monotone


def parse_rule(text: str, tree: BaseTree) -> Rule:
    """Read a rule about a tree's features and actions.

    Raises:
        ValueError: if it is none, or names what the tree does not have; the message offers near names.
    """
    return _read(text, lambda scanner: _rule(scanner, tree))


def parse_condition(text: str, tree: BaseTree) -> Condition:
    """Read a condition on a tree's features alone: what stands behind ``when``.

    Raises:
        ValueError: as `parse_rule` does.
    """
    return _read(text, lambda scanner: _joined(scanner, lambda: about_features(scanner, tree)))


def _read(text: str, read: Callable[[Scanner], _T]) -> _T:
    scanner = Scanner(text)
    found = read(scanner)
    if not scanner.at_end():
        scanner.fail("expected the end of the rule, or 'and' or 'or'")
    return found


def _rule(scanner: Scanner, tree: BaseTree) -> Rule:
    def condition() -> Condition:
        return _joined(scanner, lambda: about_features(scanner, tree))

    if scanner.word("when"):
        before = condition()
        if not scanner.word("then"):
            scanner.fail("expected 'and', 'or' or 'then'")
        return Rule(before, _claim(scanner, tree))
    claim = _claim(scanner, tree)
    return Rule(condition() if scanner.word("when") else ALWAYS, claim)


def _claim(scanner: Scanner, tree: BaseTree) -> Condition | Monotone:
    found: list[Monotone] = []

    def term() -> Condition:
        claim = about_actions(scanner, tree)
        if isinstance(claim, Monotone):
            found.append(claim)
            return ALWAYS
        return claim

    never = scanner.word("never", "always") == "never"
    joined = _joined(scanner, term)
    if not found:
        return Not(joined) if never else joined
    if joined != ALWAYS or never:
        scanner.fail("a monotonicity is a claim of its own, without 'and', 'or', 'not' and 'never'")
    return found[0]


def _joined(scanner: Scanner, term: Callable[[], Condition]) -> Condition:
    """Terms joined by or, and, not and parentheses, which bind in this order."""

    def alternatives() -> Condition:
        parts = [conjunction()]
        while scanner.word("or"):
            parts.append(conjunction())
        return parts[0] if len(parts) == 1 else Any(tuple(parts))

    def conjunction() -> Condition:
        parts = [unit()]
        while scanner.word("and"):
            parts.append(unit())
        return parts[0] if len(parts) == 1 else All(tuple(parts))

    within = 0

    def unit() -> Condition:
        nonlocal within
        negated = scanner.word("not")
        if not negated and not scanner.sign("("):
            return term()
        within += 1
        if within > DEEPEST:
            raise ValueError(
                f"the rule nests too deeply: more than {DEEPEST} 'not' and '(' within each other"
            )
        inner = unit() if negated else alternatives()
        if not negated and not scanner.sign(")"):
            scanner.fail("expected ')'")
        within -= 1
        return Not(inner) if negated else inner

    return alternatives()
