"""The arguments of commands: how they are read from a command line, and those that commands share.

A command's arguments are a dataclass beside it: a field is a flag, its docstring the help. What is wrong with the words
is one line.
"""

from __future__ import annotations

import ast
import contextlib
import dataclasses
import difflib
import io
import tomllib
import types
import typing
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeAlias, TypeVar, Union

import tyro
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from ..bounded import parse_toml
from ..counts import parse_count
from ..envs.arguments import to_plain

Arguments = TypeVar("Arguments")
Text: TypeAlias = tyro.conf.Positional[str]
Folder: TypeAlias = tyro.conf.Positional[Path]
EnvKwargs: TypeAlias = Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=VALUE ...")]
Flag: TypeAlias = Annotated[bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(help_behavior_hint="")]
"""A flag that is off unless given."""
OptionalPath: TypeAlias = Annotated[Path | None, tyro.conf.arg(metavar="PATH", help_behavior_hint="")]
MaxRules: TypeAlias = Annotated[int | None, tyro.conf.arg(metavar="INT", help_behavior_hint="")]
"""The limit of a tree's leaves, which `parse` writes as one of nodes."""
OptionalText: TypeAlias = Annotated[str | None, tyro.conf.arg(metavar="STR", help_behavior_hint="")]
Texts: TypeAlias = Annotated[tuple[str, ...], tyro.conf.arg(metavar="STR ...", help_behavior_hint="")]


@dataclass(kw_only=True)
class PlaysRun:
    """Arguments of commands that play episodes of a run that is there."""

    env: str | None = None
    """The environment, where the run's folder cannot make it: an id, or module:Name or file.py:Name, whose code is
    imported."""

    trust: bool = False
    """Import the module or file that the run's folder names, which runs its code."""


@dataclass
class Workers:
    """Choose where trainings run. Results do not depend on it."""

    workers: int = 1
    """Number of processes on this machine."""

    scheduler: OptionalText = None
    """Address of a Dask scheduler whose workers run the trainings, such as tcp://host:8786."""


_NUMBERS = ConstructorRegistry()


@_NUMBERS.primitive_rule
def _whole_numbers(kind: PrimitiveTypeInfo) -> PrimitiveConstructorSpec | None:
    """Read 1e6 and 200k as whole numbers, too."""
    if kind.type is not int:
        return None
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="INT",
        instance_from_str=lambda words: parse_count(words[0]),
        is_instance=lambda value: isinstance(value, int) and not isinstance(value, bool),
        str_from_instance=lambda value: [str(value)],
    )


def parse(
    kind: type[Arguments], command: str, words: Sequence[str], default: Arguments | None = None
) -> Arguments:
    """Parse the words after a command's name.

    Args:
        kind: The dataclass of the command's arguments.
        command: The command's name, for messages.
        words: The words.
        default: Values of what is not given; by default those of the dataclass.

    Returns:
        The arguments.

    Raises:
        ValueError: A word is unknown or has a wrong value; the message is one line.
        SystemExit: The words ask for help, which is printed.
    """
    _write_checkable_types(kind)
    if "--max-rules" in _flags(kind):
        words = _rules_as_nodes(words)
    options: dict[str, Any] = {} if default is None else {"default": default}
    printed = io.StringIO()
    try:
        with _NUMBERS, contextlib.redirect_stderr(printed):
            parsed, unknown = tyro.cli(
                kind,
                args=list(words),
                prog=f"sympol {command}",
                config=(tyro.conf.OmitArgPrefixes,),
                return_unknown_args=True,
                **options,
            )
    except SystemExit as stop:
        if stop.code in (0, None):
            raise
        raise ValueError(f"{_first_box(printed.getvalue())} (see sympol {command} --help)") from None
    if unknown:
        near = difflib.get_close_matches(unknown[0].replace("_", "-"), [*_flags(kind)], cutoff=0.7)
        hint = f"did you mean {' or '.join(near)}?" if near else f"see sympol {command} --help"
        raise ValueError(f"unknown argument {unknown[0]!r}; {hint}")
    return parsed


def _rules_as_nodes(words: Sequence[str]) -> list[str]:
    """Replace --max-rules by --max-nodes: a tree of r rules, its leaves, has 2r - 1 nodes."""
    replaced, waiting = [], iter(words)
    for word in waiting:
        flag, equals, value = word.partition("=")
        if flag.replace("_", "-") == "--max-rules":
            value = value if equals else next(waiting, "")
            try:
                rules = parse_count(value)
            except ValueError as error:
                raise ValueError(f"--max-rules {error}") from None
            if rules < 1:
                raise ValueError(
                    f"--max-rules must be at least 1, got {rules}: a tree of one leaf has one rule"
                )
            word = f"--max-nodes={2 * rules - 1}"
        replaced.append(word)
    limits = [word.partition("=")[0].replace("_", "-") for word in replaced]
    if [*replaced] != [*words] and limits.count("--max-nodes") > 1:
        raise ValueError(
            "--max-rules and --max-nodes are the same limit, nodes = 2 rules - 1: give one of them"
        )
    return replaced


def _write_checkable_types(kind: Any) -> None:
    """Write the types of a dataclass's fields in forms whose defaults tyro checks by itself.

    For `X | None` and `tuple[str, ...]` it imports typeguard, which takes as long as importing NumPy.
    """
    hints = typing.get_type_hints(kind, include_extras=True)
    kind.__annotations__ = {name: _checkable(hint) for name, hint in hints.items()}


def _checkable(hint: Any) -> Any:
    if isinstance(hint, types.UnionType):
        return Union[*map(_checkable, typing.get_args(hint))]
    if typing.get_origin(hint) is Annotated:
        inner, *extras = typing.get_args(hint)
        return Annotated[_checkable(inner), *extras]
    return tuple if hint == tuple[str, ...] else hint  # tyro takes the entries of a bare tuple for str


def _flags(kind: Any) -> Iterator[str]:
    """Yield the flags of a dataclass and of the dataclasses in it."""
    for field in dataclasses.fields(kind):
        if dataclasses.is_dataclass(field.default_factory):
            yield from _flags(field.default_factory)
        yield f"--{field.name}".replace("_", "-")


def _first_box(text: str) -> str:
    """Return the first paragraph of the box that tyro draws, as a line."""
    lines = [line.strip("│ ") for line in text.splitlines() if line.startswith("│")]
    paragraph = lines[: next((i for i, line in enumerate(lines) if set(line) == {"─"}), len(lines))]
    return " ".join(paragraph).rstrip(".") or " ".join(text.split())


def env_kwargs(words: Sequence[str]) -> dict[str, Any]:
    """Return ``NAME=VALUE ...`` as keyword arguments of an environment.

    Args:
        words: The words after ``--env-kwargs``. A value is read as Python or TOML: a number, True or true, None, a
            list, a text in quotes. What is neither is text.

    Returns:
        The values by name.

    Raises:
        ValueError: A word has another form, a name is given twice, a value is nested too deep or has a type that a
            run's folder cannot keep, such as a date.
    """
    kwargs: dict[str, Any] = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals or not name.isidentifier():
            raise ValueError(f"--env-kwargs must be of the form NAME=VALUE, as in view_size=5, got {word!r}")
        if name in kwargs:
            raise ValueError(f"--env-kwargs must name each argument once, got {name} twice")
        kwargs[name] = _value(value)
        to_plain(kwargs[name], f"--env-kwargs {name}")
    return kwargs


def _value(text: str) -> Any:
    try:
        with contextlib.suppress(SyntaxError, TypeError, ValueError):
            return ast.literal_eval(text.strip())
        return parse_toml(f"value = {text}", "the value")["value"]
    except ValueError as error:
        if isinstance(error.__cause__, tomllib.TOMLDecodeError):
            return text
    except (RecursionError, MemoryError):
        pass
    raise ValueError(f"--env-kwargs must not be nested so deep, got {text[:40]!r}...")
