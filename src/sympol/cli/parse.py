"""How the words on a command's line become its arguments, and what is wrong with them one line."""

from __future__ import annotations

import ast
import contextlib
import dataclasses
import difflib
import io
import tomllib
from collections.abc import Sequence
from dataclasses import field, make_dataclass
from typing import Annotated, Any, TypeVar, get_type_hints

import tyro
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from ..algorithms.config import Config
from ..algorithms.presets import preset
from ..envs.arguments import to_plain
from .arguments import Train
from .tree_io import tree_from

Given = TypeVar("Given")

_NUMBERS = ConstructorRegistry()


@_NUMBERS.primitive_rule
def _whole_numbers(kind: PrimitiveTypeInfo) -> PrimitiveConstructorSpec | None:
    """Read 1e6 where a whole number is asked for, too."""
    if kind.type is not int:
        return None
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="INT",
        instance_from_str=lambda words: _whole(words[0]),
        is_instance=lambda value: isinstance(value, int) and not isinstance(value, bool),
        str_from_instance=lambda value: [str(value)],
    )


def _whole(word: str) -> int:
    with contextlib.suppress(ValueError):
        return int(word)
    with contextlib.suppress(ValueError, OverflowError):
        if (number := float(word)) == int(number):
            return int(number)
    raise ValueError(f"must be a whole number, got {word!r}")


def parse(kind: type[Given], command: str, arguments: Sequence[str], default: Given | None = None) -> Given:
    """Arguments as ``kind``; what is wrong with them in one line."""
    options: dict[str, Any] = {} if default is None else {"default": default}
    said = io.StringIO()
    try:
        with _NUMBERS, contextlib.redirect_stderr(said):
            parsed, unknown = tyro.cli(
                kind,
                args=list(arguments),
                prog=f"sympol {command}",
                config=(tyro.conf.OmitArgPrefixes,),
                return_unknown_args=True,
                **options,
            )
    except SystemExit as stop:
        if stop.code in (0, None):
            raise
        raise ValueError(f"{_first_box(said.getvalue())} (see sympol {command} --help)") from None
    if unknown:
        kinds: tuple[Any, ...] = (kind, Config) if kind is Train else (kind,)
        flags = [f"--{f.name}".replace("_", "-") for k in kinds for f in dataclasses.fields(k)]
        near = difflib.get_close_matches(unknown[0].replace("_", "-"), flags)
        hint = f"did you mean {' or '.join(near)}?" if near else f"see sympol {command} --help"
        raise ValueError(f"unknown argument {unknown[0]!r}; {hint}")
    return parsed


def env_kwargs(given: Sequence[str]) -> dict[str, Any]:
    """Return ``NAME=VALUE ...`` as keyword arguments.

    A value is what Python or TOML reads in it: a number, True or true, None, a list, a text in quotes; or else a word.

    Raises:
        ValueError: An argument of another form, a name given twice, a value nested too deep, or of a type that a run's
            folder cannot keep, such as a date.
    """
    kwargs: dict[str, Any] = {}
    for argument in given:
        name, equals, value = argument.partition("=")
        if not equals or not name.isidentifier():
            raise ValueError(
                f"--env-kwargs must be of the form NAME=VALUE, as in view_size=5, got {argument!r}"
            )
        if name in kwargs:
            raise ValueError(f"--env-kwargs must name each argument once, got {name} twice")
        kwargs[name] = _value(value)
        to_plain(kwargs[name], f"--env-kwargs {name}")
    return kwargs


def _value(text: str) -> Any:
    try:
        with contextlib.suppress(SyntaxError, TypeError, ValueError):
            return ast.literal_eval(text.strip())
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text
    except (RecursionError, MemoryError):
        raise ValueError(f"--env-kwargs must not be nested so deep, got {text[:40]!r}...") from None


def parse_train(arguments: Sequence[str]) -> Train:
    """In two passes: the first finds environment and preset, from which the flags not given take their values."""
    first: Any = _unchecked()()
    with contextlib.suppress(ValueError):  # the second pass says it
        asks = {"-h", "--help"} & set(arguments)
        first = parse(type(first), "train", [a for a in arguments if a not in asks])
    which = {"algorithm": first.config.algorithm, "policy": first.config.policy}
    values = preset("" if first.env_kwargs else first.env, first.preset, **which)
    if first.start is not None and first.config.policy == "tree":
        values = {**values, "depth": max(values.get("depth", Config.depth), tree_from(first.start).depth)}
    return parse(Train, "train", arguments, Train("", config=Config.from_dict({**which, **values})))


def _unchecked() -> type:
    """`Train` whose config may hold anything: without its preset, what was given need not fit together."""
    fields = make_dataclass("Fields", _fields_of(Config))
    config = ("config", Annotated[fields, tyro.conf.arg(name="")], field(default_factory=fields))
    return make_dataclass("First", [*(f for f in _fields_of(Train) if f[0] != "config"), config])


def _fields_of(kind: type) -> list[tuple[str, Any, Any]]:
    hints = get_type_hints(kind, include_extras=True)
    return [
        (f.name, hints[f.name], "" if f.default is dataclasses.MISSING else f.default)
        for f in dataclasses.fields(kind)
    ]


def _first_box(text: str) -> str:
    """What tyro draws as a box, its first paragraph, as a line."""
    lines = [line.strip("│ ") for line in text.splitlines() if line.startswith("│")]
    paragraph = lines[: next((i for i, line in enumerate(lines) if set(line) == {"─"}), len(lines))]
    return " ".join(paragraph).rstrip(".") or " ".join(text.split())
