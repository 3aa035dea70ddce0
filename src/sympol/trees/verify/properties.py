"""Properties: rules with names, alone or in a file.

```toml
[[property]]
name = "pushes back"
rule = "when pole angle > 0.1 and pole angular velocity > 0.5 then action is push right"

[[property]]
name = "a number that is none pushes right, too"
rule = "action is never push left when cart position > 4.8"
within_bounds = false
```
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TypeAlias, final

from ... import files
from ...bounded import LARGEST_BY_HAND, parse_toml
from ..floats import brief

_TYPES = {"name": str, "rule": str, "within_bounds": bool}


@final
@dataclass(frozen=True)
class Property:
    """What has to be true of a policy.

    Args:
        rule: In the language of `sympol.trees.verify.language`.
        name: What to call it; by default the rule itself.
        within_bounds: Whether only observations within the bounds of the observation space count; without,
            infinite numbers and NaN count, too.
    """

    rule: str
    name: str = ""
    within_bounds: bool = True

    def __post_init__(self) -> None:
        """Fill in the name."""
        object.__setattr__(self, "name", self.name or self.rule)


Said: TypeAlias = str | Property | PathLike[str]
"""A rule, a property, or the path of a file of properties."""


def properties(said: Iterable[Said]) -> tuple[Property, ...]:
    """Return the properties that rules, properties and files are, in their order.

    Raises:
        OSError: if a file cannot be read.
        ValueError: if it holds no properties.
    """
    found: list[Property] = []
    for one in said:
        if isinstance(one, Property):
            found.append(one)
        elif isinstance(one, str):
            found.append(Property(one))
        else:
            found += read_properties(one)
    return tuple(found)


def read_properties(path: PathLike[str]) -> tuple[Property, ...]:
    """Read the ``[[property]]`` tables of a TOML file.

    Raises:
        OSError: if it cannot be read.
        ValueError: if it is not TOML, holds no property, or anything else.
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
    return tuple(_property(path, number, table) for number, table in enumerate(tables, 1))


def _property(path: PathLike[str], number: int, table: object) -> Property:
    where = f"property {number} of {path}"
    if not isinstance(table, dict) or "rule" not in table:
        raise ValueError(f'{where} has no rule; write rule = "when … then …"')
    for key, value in table.items():
        if key not in _TYPES:
            raise ValueError(f"{where} has an unknown key {brief(key)}; there are {', '.join(_TYPES)}")
        if not isinstance(value, _TYPES[key]):
            kind = "true or false" if _TYPES[key] is bool else "a string"
            raise ValueError(f"{where}: {key} must be {kind}, got {brief(value)}")
    return Property(**table)
