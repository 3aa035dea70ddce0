"""A sample of the malformed inputs of studies/benchmarks/fuzz.py, and that it finds what it looks for."""

from __future__ import annotations

import time
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from studies.benchmarks.fuzz_ask import Broken, Failure, asked, in_process, outcomes
from studies.benchmarks.fuzz_classes import CLASSES
from studies.benchmarks.fuzz_commands import Box, Said, call, ruled, terminal
from studies.benchmarks.fuzz_inputs import smaller
from studies.benchmarks.kills import differences

SEED = 19
INPUTS = {"json": 300, "text": 400, "properties": 100, "runs": 120, "flags": 60, "observations": 500}


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


@pytest.mark.parametrize("name", CLASSES)
def test_each_is_answered_or_refused_in_one_line(name, scratch):
    found = in_process(CLASSES[name], SEED, range(INPUTS[name]), scratch)
    failures = [
        f"{failure.kind}: {failure.given[:2000]}\n{failure.detail}" for failure in found.failures.values()
    ]
    assert not failures, "\n\n".join(failures)
    assert found.inputs == INPUTS[name]
    assert found.inputs / 50 < found.answered < found.inputs


@pytest.mark.parametrize("name", CLASSES)
def test_a_seed_and_a_number_are_an_input(name, scratch):
    one, other = (CLASSES[name](scratch) for _ in range(2))
    for number in range(20):
        assert repr(one.make(Random(f"0 {number}"))) == repr(other.make(Random(f"0 {number}")))


class Wrong:
    """What breaks the rule in every way there is, by the letter that is in it."""

    def make(self, dice: Random) -> tuple[str]:
        return ("".join(dice.choice("abcdefghi") for _ in range(40)) + dice.choice("RHMKTV"),)

    def ask(self, given: tuple[str]) -> bool:
        (text,) = given
        match text[-1:]:
            case "R":
                return self.ask(given)
            case "H":
                time.sleep(100)
            case "M":
                np.ones(2**40, np.uint8)
            case "K":
                {}[text]
            case "T":
                raise Broken("wrong", text)
        return True


def test_what_breaks_the_rule_is_found_and_made_short(monkeypatch):
    monkeypatch.setattr("studies.benchmarks.fuzz_ask.WAIT", 0.2)
    found: dict[str, Failure] = {}
    for _, outcome in outcomes(Wrong(), 0, range(20)):
        if isinstance(outcome, Failure):
            found.setdefault(outcome.kind.split(" in ")[0], outcome)
    assert set(found) == {"RecursionError", "too long", "too much memory", "KeyError", "wrong"}
    assert {found[kind].given for kind in ("RecursionError", "KeyError", "wrong")} == {
        "('R',)",
        "('K',)",
        "('T',)",
    }


def test_processor_time_is_limited():
    def endless(given: Any) -> bool:
        while True:
            pass

    fuzzer = Wrong()
    fuzzer.ask = endless  # type: ignore[method-assign]
    began = time.process_time()
    answered = asked(fuzzer, ("x",), seconds=0.1)
    assert isinstance(answered, tuple)
    assert answered[0].startswith("too long")
    assert time.process_time() - began < 2


def test_a_list_and_a_text_are_made_short():
    assert smaller("aaaaXbbbb", lambda part: "X" in part) == "X"
    assert smaller([1, 2, 3, 4, 5], lambda part: 2 in part and 5 in part) == [2, 5]


@pytest.mark.parametrize(
    ("said", "kind"),
    [
        (Said(2, "", "error: a\nerror: b\n"), "2 error lines"),
        (Said(2, "", ""), "0 error lines"),
        (Said(1, "", "no\n"), "status 1"),
        (Said(130, "", ""), "status 130"),
        (Said(0, "\x1b[31m", ""), "control character"),
        (Said(0, "a\x9bb", ""), "control character"),
        (Said(0, "", "x.py:3: RuntimeWarning: overflow\n  x + 1\n"), "a warning with its line of code"),
        (Said(2, "", "Traceback (most recent call last):\nerror: x\n"), "traceback"),
    ],
)
def test_what_a_command_may_not_say(said, kind):
    with pytest.raises(Broken, match=kind):
        ruled(["show"], said)


def test_what_a_command_may_say():
    ruled(["show", "x"], call(["show", "x"]))
    ruled(["verify", "x"], Said(1, "✗ a rule\n", ""))
    terminal("≤ a tree\n\tand a tab", "show")


def test_a_file_that_is_lost_or_written_elsewhere_is_found(scratch):
    box = Box(scratch)
    for wrong, kind in {
        lambda: (box.work / "run/policy.json").unlink(): "changes what it reads",
        lambda: (box.outside / "precious.txt").write_text(""): "writes through a link",
        lambda: (box.outside / "new.txt").write_text("what must not change\n"): "outside its folder",
    }.items():
        box.fill({})
        with pytest.raises(Broken, match=kind):
            box.run(["show", "run"], lambda wrong=wrong: [wrong()])
        (box.outside / "new.txt").unlink(missing_ok=True)
    box.fill({})
    with pytest.raises(Broken, match="refuses, and writes"):
        box.run(["show", "run"], lambda: (box.work / "run/new.txt").write_text("x") and None)


def test_trainings_that_differ_are_told_apart():
    assert differences({"a": 1, "b": 2}, {"a": 1, "b": 3, "c": 0}) == ["b", "c"]
