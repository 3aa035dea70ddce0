"""Trees as JSON and as text, and properties of trees; for `studies.benchmarks.fuzz`."""

from __future__ import annotations

import contextlib
import dataclasses
import json
from pathlib import Path
from random import Random

import numpy as np
from tests.trees.samples import ACTIONS, HOSTILE_NAMES, chain, random_grouped_tree, random_tree
from tests.trees.verify.questions import as_text, random_case, random_claim, random_condition

from sympol.trees import DecisionTree
from sympol.trees.export import FORMATS

from .fuzz_ask import Broken
from .fuzz_commands import Box, Content, terminal
from .fuzz_inputs import as_argument, as_bytes, as_toml, changed_document, changed_text
from .timing import ROOT

TEXTS = tuple(name for name, form in FORMATS.items() if not form.binary)


def _trees() -> list[DecisionTree]:
    """Trees of every kind, real ones among them."""
    golden = sorted((ROOT / "tests" / "golden" / "trees").glob("*.json"))
    found = [DecisionTree.from_json(path.read_text(encoding="utf-8")) for path in golden]
    rng = np.random.default_rng(0)
    for actions in ACTIONS.values():
        found += [random_tree(rng, actions, 2), random_grouped_tree(rng, actions, 3)]
    names = tuple(HOSTILE_NAMES[:3])
    return [*found, dataclasses.replace(random_tree(rng, ACTIONS["discrete"], 2), feature_names=names)]


def usable(tree: DecisionTree, form: str) -> None:
    """Raise whatever is wrong with a tree that was read: it must act, and be written and read again."""
    if DecisionTree.from_json(tree.to_json()) != tree:
        raise Broken("another tree after it is written and read as JSON")
    if not tree.groups:  # of which one feature must be 1
        tree.predict(np.zeros(tree.n_features))
    with contextlib.suppress(ValueError):  # a format may refuse what it cannot say
        tree.export(form)
    with contextlib.suppress(ValueError):
        terminal(str(tree), "to_text")


class Json:
    """Trees as JSON: (format to export to, text)."""

    def __init__(self, scratch: Path) -> None:
        self.texts = [tree.to_json() for tree in _trees()]

    def make(self, dice: Random) -> tuple[str, str]:
        """Change the document, or the text."""
        form, text = dice.choice(TEXTS), dice.choice(self.texts)
        if dice.random() < 0.005:
            depth = dice.choice((100, 1000, 20_000))
            return form, chain(depth, to_left=dice.random() < 0.5, actions=ACTIONS["discrete"]).to_json()
        if dice.random() < 0.75:
            return form, json.dumps(changed_document(dice, json.loads(text)))
        return form, changed_text(dice, text)

    def ask(self, given: tuple[str, str]) -> bool:
        """Read it; use it."""
        try:
            tree = DecisionTree.from_json(given[1])
        except ValueError:
            return False
        usable(tree, given[0])
        return True


class Text:
    """Trees as text, with a header or beside another tree: (format, number of that tree or None, text)."""

    def __init__(self, scratch: Path) -> None:
        self.trees = _trees()
        self.words = (
            "yes: ",
            "no: ",
            "  ",
            "   ",
            " <= ",
            " > ",
            " is ",
            " is not ",
            "+++\n",
            "env = ",
            "\t",
        )

    def make(self, dice: Random) -> tuple[str, int | None, str]:
        """Write a tree by hand, or change what is written of one."""
        form, which = dice.choice(TEXTS), dice.randrange(len(self.trees))
        tree = self.trees[which]
        text = str(tree) if dice.random() < 0.6 else self._by_hand(dice, tree)
        if dice.random() < 0.4:
            header = self._header(dice, tree)
            return form, None, f"+++\n{header}\n+++\n{text}"
        return form, which, text if dice.random() < 0.2 else changed_text(dice, text, self.words)

    def ask(self, given: tuple[str, int | None, str]) -> bool:
        """Read it; use it."""
        form, which, text = given
        try:
            tree = DecisionTree.from_text(text, like=None if which is None else self.trees[which])
        except ValueError:
            return False
        usable(tree, form)
        return True

    @staticmethod
    def _header(dice: Random, tree: DecisionTree) -> str:
        document = json.loads(tree.to_json())
        kept = {key: document[key] for key in ("features", "actions", "groups", "meta") if document.get(key)}
        for group in kept.get("groups", []):
            group.pop("cell")
        how = dice.random()
        header = as_toml(changed_document(dice, kept) if how < 0.6 else kept) or 'env = "CartPole-v1"'
        return header if how < 0.8 else changed_text(dice, header)

    def _by_hand(self, dice: Random, tree: DecisionTree, depth: int = 0) -> str:
        if depth == 4 or dice.random() < 0.3:
            return dice.choice(tree.actions.words(tree.actions.decide(tree.value[-1:])[0]))
        question = f"{dice.choice(tree.feature_names)} {dice.choice(('<=', '≤', '<', '>', '≥'))} "
        question += dice.choice(("0", "-0.5", "1e-3", "1e38", "1e39", ".5"))
        below = [f"{label}: {self._by_hand(dice, tree, depth + 1)}" for label in ("yes", "no")]
        if dice.random() < 0.3:
            below.reverse()
        return "\n".join([question, *("  " + line for part in below for line in part.split("\n"))])


class Properties:
    """Properties of trees: (number of the tree, where the rule stands, rule)."""

    def __init__(self, scratch: Path) -> None:
        self.box = Box(scratch)
        self.cases: dict[int, DecisionTree] = {}

    def make(self, dice: Random) -> tuple[int, str, str]:
        """Say something that a tree may do, and change the words of it."""
        which = dice.randrange(60)
        rng, tree = np.random.default_rng(dice.getrandbits(32)), self._tree(which)
        names = tree.feature_names
        condition, claim = (
            as_text(make(rng, tree), tree, names) for make in (random_condition, random_claim)
        )
        action = dice.choice(getattr(tree.actions, "names", ("action",)))
        rule = dice.choice(
            (
                *(f"when {condition} then {claim}", f"{claim} when {condition}", f"never {claim}"),
                *(
                    f"{action} is increasing in {dice.choice(names)}",
                    f"when {condition} then action is never 0",
                ),
                f"when {dice.choice(names)} between {dice.choice(('0', '-1'))} and 1 then always {claim}",
            )
        )
        words = (*names, action, "when ", " then ", " and ", " or ", "not ", " is ", " one of ", " between ")
        rule = rule if dice.random() < 0.2 else changed_text(dice, rule, words)
        return which, dice.choice(("python",) * 8 + ("flag", "file")), rule

    def ask(self, given: tuple[int, str, str]) -> bool:
        """Prove it."""
        which, where, rule = given
        tree = self._tree(which)
        if where == "python":
            try:
                for verdict in tree.verify(rule):
                    terminal(verdict.words, "a verdict")
            except ValueError:
                return False
            return True
        put: dict[str, Content] = {"its.json": tree.to_json().encode()}
        words = ["verify", "its.json"]
        if where == "file":
            put["its.toml"] = as_bytes(rule if "[[" in rule else f"[[property]]\nrule = '{rule}'\n")
            words += ["--properties", "its.toml"]
        elif (words_of := as_argument(rule)) is not None:
            words += ["--property", words_of]
        self.box.fill(put)
        return self.box.run(words)

    def _tree(self, which: int) -> DecisionTree:
        if which not in self.cases:
            self.cases[which] = random_case(np.random.default_rng(which), grouped=which % 2 == 1)
        return self.cases[which]
