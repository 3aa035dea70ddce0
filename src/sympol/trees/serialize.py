"""Serialization: trees as strict JSON, described for other programs in docs/guides/tree-json.md.

```
{"format": "sympol.tree", "version": 1,
 "features": [{"name": "pole angle", "low": -0.418, "high": "inf"}, …],      no bound: "-inf" or "inf";
                                                                             "integer": true where it is one
 "groups": [{"name": "front", "features": [3, 4], "categories": ["wall", "door"], "cell": [5, 3]}, …],
                                                                             only where there are groups
 "actions": {"type": "discrete", "start": 0, "names": ["left", "right"]},
 "nodes": [{"feature": 0, "threshold": 0.01, "left": 1, "right": 2},         preorder, the root first
           {"value": [1.5, -1.5], "visits": 62}, …],                         visits: at every leaf or at none
 "meta": {…}}
```

Numbers are float32 in the fewest digits that give them back. The file may come from a stranger: reading it
runs no code, takes memory in proportion to the text, and refuses whatever is not as above with a ValueError.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator
from typing import Any, Never

import numpy as np

from ..bounded import parse_json
from .actions import ActionSpec, BoxActions, DiscreteActions, MultiDiscreteActions
from .base import BaseTree, TreeT
from .floats import brief, shortest
from .groups import LARGEST_CELL, Group
from .preorder import NO_CHILD, NO_FEATURE, NO_THRESHOLD

FORMAT = "sympol.tree"
VERSION = 1

_LARGEST_INTEGER = 2**53  # what every JSON reader holds exactly
_TOO_LARGE = 2.0**128 - 2.0**103  # the least number that float32 rounds to infinity
_MOST_DIMENSIONS = 32


def to_json(tree: BaseTree) -> str:
    """Write the tree as JSON, one line for each feature and each node."""
    bounds = zip(tree.feature_names, tree.feature_low, tree.feature_high, strict=True)
    features = [
        {"name": name, "low": _bound(low), "high": _bound(high)}
        | ({"integer": True} if i in tree.integers else {})
        for i, (name, low, high) in enumerate(bounds)
    ]
    head = f'{{"format": {json.dumps(FORMAT)}, "version": {VERSION},\n'
    groups = f'"groups": {_lines(map(_group_to_json, tree.groups))},\n' if tree.groups else ""
    return (
        f'{head}"features": {_lines(features)},\n{groups}"actions": {json.dumps(_actions_to_json(tree.actions))},\n'
        f'"nodes": {_lines(_node_to_json(tree, node) for node in range(tree.n_nodes))},\n'
        f'"meta": {json.dumps(tree.meta, allow_nan=False)}}}\n'
    )


def from_json(text: str, kind: type[TreeT]) -> TreeT:
    """Read a tree.

    Raises:
        ValueError: if the text is not JSON, not of this format and version, not a tree, or larger or nested deeper
            than `sympol.trees.bounded` reads.
    """
    return _read(parse_json(text), kind)


def _lines(items: Iterable[object]) -> str:
    return "[\n " + ",\n ".join(json.dumps(item, allow_nan=False) for item in items) + "\n]"


def _bound(x: float) -> float | str:
    return shortest(x) if math.isfinite(x) else str(float(x))


def _node_to_json(tree: BaseTree, node: int) -> dict[str, Any]:
    if tree.is_leaf[node]:
        value = {"value": [shortest(x) for x in tree.leaf_outputs[node]]}
        return value if tree.n_node_samples is None else {**value, "visits": int(tree.n_node_samples[node])}
    return {
        "feature": int(tree.feature[node]),
        "threshold": shortest(tree.threshold[node]),
        "left": int(tree.children_left[node]),
        "right": int(tree.children_right[node]),
    }


def _group_to_json(group: Group) -> dict[str, Any]:
    return {
        "name": group.name,
        "features": group.features,
        "categories": group.categories,
        "cell": group.cell,
    }


def _actions_to_json(actions: ActionSpec) -> dict[str, Any]:
    if isinstance(actions, DiscreteActions):
        return {"type": "discrete", "start": actions.start, "names": actions.names}
    if isinstance(actions, MultiDiscreteActions):
        parts = zip(actions.names, actions.start, actions.options, strict=True)
        components = [{"name": name, "start": start, "options": options} for name, start, options in parts]
        return {"type": "multi_discrete", "components": components}
    stds = actions.std or (None,) * actions.n_outputs
    parts = zip(actions.names, actions.low, actions.high, stds, strict=True)
    components = [
        {"name": name, "low": _bound(low), "high": _bound(high)}
        | ({} if std is None else {"std": shortest(std)})
        for name, low, high, std in parts
    ]
    return {"type": "box", "shape": actions.shape, "components": components}


def _read(document: object, kind: type[TreeT]) -> TreeT:
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise ValueError(f'not a tree of sympol: it lacks "format": "{FORMAT}"')
    if document.get("version") != VERSION:
        raise ValueError(
            f"version {brief(document.get('version'))} of the format; this sympol reads version {VERSION}"
        )
    keys = ("format", "version", "features", "actions", "nodes", "meta")
    _fields(document, "the document", *keys, optional="groups")
    features = [
        _fields(feature, f"features[{i}]", "name", "low", "high", optional="integer")
        for i, feature in enumerate(_list(document["features"], "features"))
    ]
    actions = read_actions(document["actions"])
    return kind(
        **_read_nodes(_list(document["nodes"], "nodes"), actions.n_outputs),
        actions=actions,
        feature_names=tuple(_string(feature["name"], "a feature's name") for feature in features),
        feature_low=np.array([_number(feature["low"], "low", unbounded=True) for feature in features]),
        feature_high=np.array([_number(feature["high"], "high", unbounded=True) for feature in features]),
        groups=tuple(_read_groups(document)),
        integers=tuple(i for i, feature in enumerate(features) if _true_or_absent(feature, "integer")),
        meta=document["meta"]
        if isinstance(document["meta"], dict)
        else _fail("meta", "an object", document["meta"]),
    )


def _read_groups(document: dict[str, Any]) -> Iterator[Group]:
    if "groups" in document and not _list(document["groups"], "groups"):
        _fail("groups", "left out where there are none", document["groups"])
    for i, spec in enumerate(document.get("groups", [])):
        where = f"groups[{i}]"
        group = _fields(spec, where, "name", "features", "categories", "cell")
        features = _list(group["features"], f"{where}.features")
        last = len(document["features"]) - 1
        yield Group(
            name=_string(group["name"], f"{where}.name"),
            features=tuple(_integer(feature, f"{where}.features", 0, last) for feature in features),
            categories=_strings(group["categories"], f"{where}.categories"),
            cell=None if group["cell"] is None else _read_cell(group["cell"], f"{where}.cell"),
        )


def _read_cell(cell: object, where: str) -> tuple[int, int]:
    if len(_list(cell, where)) != 2:
        _fail(where, "[row, column] or null", cell)
    row, column = (_integer(x, where, 0, LARGEST_CELL) for x in _list(cell, where))
    return row, column


def read_actions(spec: object) -> ActionSpec:
    """Read the specification of actions. Raises ValueError where it is not valid."""
    kind = spec.get("type") if isinstance(spec, dict) else None
    if kind == "discrete":
        spec = _fields(spec, "actions", "type", "start", "names")
        names = _strings(spec["names"], "names of actions")
        return DiscreteActions(len(names), names, _integer(spec["start"], "start", -_LARGEST_INTEGER))
    if kind == "multi_discrete":
        spec = _fields(spec, "actions", "type", "components")
        parts = [
            _fields(part, "a component", "name", "start", "options")
            for part in _list(spec["components"], "components")
        ]
        options = tuple(_strings(part["options"], "options") for part in parts)
        return MultiDiscreteActions(
            nvec=tuple(len(option) for option in options),
            names=tuple(_string(part["name"], "a component's name") for part in parts),
            options=options,
            start=tuple(_integer(part["start"], "start", -_LARGEST_INTEGER) for part in parts),
        )
    if kind == "box":
        return _read_box(_fields(spec, "actions", "type", "shape", "components"))
    return _fail("actions", 'of type "discrete", "multi_discrete" or "box"', spec)


def _read_box(spec: dict[str, Any]) -> BoxActions:
    components = _list(spec["components"], "components")
    noisy = bool(components) and isinstance(components[0], dict) and "std" in components[0]
    keys = ("name", "low", "high", "std") if noisy else ("name", "low", "high")
    parts = [_fields(part, "a component", *keys) for part in components]
    shape = tuple(_integer(length, "shape", 1, len(parts)) for length in _list(spec["shape"], "shape"))
    if len(shape) > _MOST_DIMENSIONS or math.prod(shape) != len(parts):
        _fail("shape", f"of {len(parts)} numbers, as many as components", shape)
    return BoxActions(
        low=tuple(_number(part["low"], "low", unbounded=True) for part in parts),
        high=tuple(_number(part["high"], "high", unbounded=True) for part in parts),
        shape=shape,
        names=tuple(_string(part["name"], "a component's name") for part in parts),
        std=tuple(_number(part["std"], "std") for part in parts) if noisy else None,
    )


def _read_nodes(nodes: list[Any], n_outputs: int) -> dict[str, Any]:
    """Return a `BaseTree`'s arrays; it checks itself that they are a tree."""
    n_nodes = len(nodes)
    leaf = np.array([isinstance(node, dict) and "value" in node for node in nodes], dtype=bool)
    if 2 * np.count_nonzero(leaf) != n_nodes + 1:
        # found here, before memory is taken for all nodes times all outputs
        raise ValueError(
            f"a binary tree has one leaf more than inner nodes, got {n_nodes} nodes, {leaf.sum()} leaves"
        )
    left, right = np.full(n_nodes, NO_CHILD), np.full(n_nodes, NO_CHILD)
    feature, threshold = np.full(n_nodes, NO_FEATURE), np.full(n_nodes, NO_THRESHOLD)
    value, visits = np.zeros((n_nodes, n_outputs)), np.zeros(n_nodes, np.int64)
    counted = any("visits" in nodes[i] for i in np.flatnonzero(leaf))
    for i in reversed(range(n_nodes)):
        where = f"nodes[{i}]"
        if leaf[i]:
            node = _fields(nodes[i], where, *(("value", "visits") if counted else ("value",)))
            numbers = _list(node["value"], f"{where}.value")
            if len(numbers) != n_outputs:
                _fail(f"{where}.value", f"{n_outputs} numbers", numbers)
            value[i] = [_number(x, f"{where}.value") for x in numbers]
            visits[i] = _integer(node["visits"], f"{where}.visits", 0) if counted else 0
        else:
            node = _fields(nodes[i], where, "feature", "threshold", "left", "right")
            feature[i] = _integer(node["feature"], f"{where}.feature", 0, 2**31 - 1)
            threshold[i] = _number(node["threshold"], f"{where}.threshold")
            left[i] = _integer(node["left"], f"{where}.left", i + 1, n_nodes - 1)
            right[i] = _integer(node["right"], f"{where}.right", i + 1, n_nodes - 1)
            visits[i] = _integer(int(visits[left[i]] + visits[right[i]]), f"visits below {where}", 0)
    return {
        "children_left": left,
        "children_right": right,
        "feature": feature,
        "threshold": threshold,
        "value": value,
        "n_node_samples": visits if counted else None,
    }


def _fail(where: str, expected: str, got: object) -> Never:
    raise ValueError(f"{where} must be {expected}, got {brief(got)}")


def _fields(value: object, where: str, *keys: str, optional: str | None = None) -> dict[str, Any]:
    if not isinstance(value, dict) or set(value) - {optional} != set(keys):
        _fail(where, f"an object of {', '.join(keys)}", value)
    return value


def _true_or_absent(fields: dict[str, Any], key: str) -> bool:
    return key in fields and (fields[key] is True or _fail(key, "true, or left out", fields[key]))


def _list(value: object, where: str) -> list[Any]:
    return value if isinstance(value, list) else _fail(where, "a list", value)


def _string(value: object, where: str) -> str:
    return value if isinstance(value, str) else _fail(where, "a string", value)


def _strings(value: object, where: str) -> tuple[str, ...]:
    return tuple(_string(name, where) for name in _list(value, where))


def _integer(value: object, where: str, low: int, high: int = _LARGEST_INTEGER) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        _fail(where, f"an integer from {low} to {high}", value)
    return value


def _number(value: object, where: str, *, unbounded: bool = False) -> float:
    if unbounded and value in ("-inf", "inf"):
        return float(str(value))
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < _TOO_LARGE:
        _fail(where, "a finite float32 number" + (', "-inf" or "inf"' if unbounded else ""), value)
    return float(value)
