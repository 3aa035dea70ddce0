"""Properties and verdicts: what must be true of a policy, and the answer.

Properties are rules with names, given one by one or in a file:

```toml
[[property]]
name = "pushes back"
rule = "when pole angle > 0.1 and pole angular velocity > 0.5 then action is push right"

[[property]]
name = "pushes right outside the bounds, too"
rule = "action is never push left when cart position > 4.8"
within_bounds = false
```
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, final

from ... import files
from ...bounded import LARGEST_BY_HAND, parse_toml
from ..base import BaseTree
from ..floats import brief, number, printable

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Float32

_TYPES = {"name": str, "rule": str, "within_bounds": bool}


@final
@dataclass(frozen=True)
class Property:
    """A rule that must hold for a policy.

    Args:
        rule: The rule, in the grammar of `sympol.trees.verify.grammar`.
        name: A name for messages; the rule itself by default.
        within_bounds: Whether only observations within the bounds of the observation space count. Otherwise
            infinities and NaN count, too.
    """

    rule: str
    name: str = ""
    within_bounds: bool = True

    def __post_init__(self) -> None:
        """Fill in the name."""
        object.__setattr__(self, "name", self.name or self.rule)


PropertyLike: TypeAlias = str | Property | PathLike[str]
"""A rule, a property, or the path of a file of properties."""


def as_properties(given: Iterable[PropertyLike]) -> tuple[Property, ...]:
    """Return rules, properties and the contents of files as properties, in their order.

    Raises:
        OSError: If a file cannot be read.
        ValueError: If a file does not hold properties.
    """
    properties: list[Property] = []
    for one in given:
        if isinstance(one, Property):
            properties.append(one)
        elif isinstance(one, str):
            properties.append(Property(one))
        else:
            properties += read_properties(one)
    return tuple(properties)


def read_properties(path: PathLike[str]) -> tuple[Property, ...]:
    """Read the ``[[property]]`` tables of a TOML file.

    Args:
        path: The file, in UTF-8.

    Returns:
        At least one property, in the order of the file.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If it is not TOML, or holds no property or anything else.
    """
    try:
        text = files.read_text(Path(path))
    except ValueError as error:
        raise ValueError(f"{path} is not TOML and cannot be read: {error}") from error
    content = parse_toml(text, str(path), most=LARGEST_BY_HAND)
    tables = content.get("property")
    if set(content) != {"property"} or not isinstance(tables, list) or not tables:
        got = ", ".join(brief(name) for name in content) or "nothing"
        raise ValueError(f"{path} must hold [[property]] tables and nothing else, got {got[:200]}")
    return tuple(_property(path, i, table) for i, table in enumerate(tables, 1))


def _property(path: PathLike[str], i: int, table: object) -> Property:
    where = f"property {i} of {path}"
    if not isinstance(table, dict) or "rule" not in table:
        raise ValueError(f'{where} has no rule; write rule = "when … then …"')
    for key, value in table.items():
        if key not in _TYPES:
            raise ValueError(f"{where} has an unknown key {brief(key)}; there are {', '.join(_TYPES)}")
        if not isinstance(value, _TYPES[key]):
            kind = "true or false" if _TYPES[key] is bool else "a string"
            raise ValueError(f"{where}: {key} must be {kind}, got {brief(value)}")
    return Property(**table)


@final
@dataclass(frozen=True, eq=False)
class Example:
    """An observation and the action that it gets.

    Args:
        observation: The observation, as the tree sees it.
        where: The observation in words, feature by feature.
        action: The action in words; both actions where two trees disagree.
    """

    observation: Float32[np.ndarray, " features"]
    where: str
    action: str


@final
@dataclass(frozen=True, eq=False)
class Verdict:
    """The answer to a property: proven, or refuted by an example.

    Args:
        name: The name of the property.
        rule: The rule in question.
        holds: Whether it is true of every observation.
        vacuous: Whether it holds only because no observation meets the condition.
        n_leaves: The number of leaves that the condition concerns.
        n_violating: The number of these in which the rule fails somewhere.
        examples: A counterexample if it fails: one observation, or two if the rule compares two.
    """

    name: str
    rule: str
    holds: bool
    vacuous: bool = False
    n_leaves: int = 0
    n_violating: int = 0
    examples: tuple[Example, ...] = ()

    @property
    def counterexample(self) -> Float32[np.ndarray, " features"] | None:
        """An observation for which the rule fails; None if it holds."""
        return self.examples[0].observation if self.examples else None

    @property
    def words(self) -> str:
        """The answer as a sentence."""
        if self.vacuous:
            return "holds vacuously: no observation meets the condition"
        if self.holds:
            return f"holds: proven for {_leaves(self.n_leaves)}"
        found = "; then ".join(f"{example.where}: {example.action}" for example in self.examples)
        return f"fails in {self.n_violating} of {_leaves(self.n_leaves)}: {found}"

    def __str__(self) -> str:
        """Return the name and the answer."""
        return f"{printable(self.name)}: {self.words}"


def example_of(tree: BaseTree, observation: Float32[np.ndarray, " features"]) -> Example:
    """Describe an observation and the action that a tree takes in it."""
    return Example(observation, observation_words(tree, observation), action_words(tree, observation))


def action_words(tree: BaseTree, observation: Float32[np.ndarray, " features"]) -> str:
    """Describe the action that a tree takes in an observation."""
    return ", ".join(tree.actions.words(tree.predict(observation)))


def observation_words(tree: BaseTree, observation: Float32[np.ndarray, " features"]) -> str:
    """Describe an observation: ``pole angle = 0.2, front is lava``."""
    phrases = []
    for feature, x in enumerate(observation):
        group = tree.group_of.get(feature)
        if group is None:
            phrases.append(f"{printable(tree.feature_names[feature])} = {number(x)}")
        elif x == 1:
            phrases.append(group.words(feature))
    return ", ".join(phrases)


def _leaves(n: int) -> str:
    return "1 leaf" if n == 1 else f"{n} leaves"
