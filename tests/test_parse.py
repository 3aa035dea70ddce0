"""What is written on the command line, as Python values."""

from __future__ import annotations

import pytest

from sympol.cli.arguments import env_kwargs
from sympol.cli.train import parse_train


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("False", False),
        ("false", False),
        ("True", True),
        ("None", None),
        ("3", 3),
        ("-1e3", -1000.0),
        ("[1, 2]", [1, 2]),
        ("[true, false]", [True, False]),
        ("[True, None]", [True, None]),
        ("(1, 2)", (1, 2)),
        ("{'a': 1}", {"a": 1}),
        ("'False'", "False"),
        ("8x8", "8x8"),
        ("007", "007"),
        ("falsehood", "falsehood"),
        ("a=b", "a=b"),
        ("", ""),
    ],
)
def test_a_value_is_what_python_or_toml_reads_in_it_or_else_a_word(text, value):
    given = env_kwargs([f"x={text}"])["x"]
    assert (type(given), given) == (type(value), value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["x"], "of the form NAME=VALUE"),
        (["1x=2"], "of the form NAME=VALUE"),
        (["x=1", "x=2"], "each argument once, got x twice"),
        (["x=" + "[" * 5_000], "nested so deep"),
        (["x=3+4j"], "--env-kwargs x is of type builtins.complex"),
        (["x=2026-01-01"], "--env-kwargs x is of type datetime.date"),
    ],
)
def test_bad_arguments_of_an_environment(arguments, message):
    with pytest.raises(ValueError, match=message):
        env_kwargs(arguments)


def test_the_preset_of_an_id_is_not_that_of_the_id_with_arguments():
    usual, changed = (parse_train(["Pendulum-v1", *more]) for more in ([], ["--env-kwargs", "g=5.0"]))
    assert usual.config != changed.config
    assert changed.config == parse_train(["no-id-with-a-preset"]).config
