"""The classes of inputs of `benchmarks.fuzz`: how each is made, and how it is asked."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import os
import re
import struct
import tomllib
import types
import typing
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random
from typing import Any, ClassVar, Literal, get_args, get_origin

import gymnasium
import numpy as np
import tomli_w
from gymnasium.spaces import Box as BoxSpace
from gymnasium.spaces import Dict, Discrete, MultiBinary, MultiDiscrete, Tuple
from tests.tiny import Chain
from tests.trees.samples import ACTIONS, HOSTILE_NAMES, chain, random_grouped_tree, random_tree
from tests.trees.verify.questions import as_text, random_case, random_claim, random_condition

import sympol
from sympol.algos.config import Config
from sympol.commands import arguments, diff, explain, export, pareto, report, verify
from sympol.envs.host import EnvironmentFailure
from sympol.runs.about import RunError
from sympol.runs.folder import Run
from sympol.trees import DecisionTree
from sympol.trees.export import FORMATS

from .fuzz_ask import Broken, Fuzzer
from .fuzz_commands import EVIL, Box, Content, Folder, Link, terminal
from .fuzz_inputs import as_bytes, changed_document, changed_list, changed_text
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
        terminal(str(tree))


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
        header = _as_toml(changed_document(dice, kept) if how < 0.6 else kept) or 'env = "CartPole-v1"'
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


def _as_toml(document: Any) -> str | None:
    """Write a document; None where it holds what TOML has not."""
    with contextlib.suppress(AttributeError, TypeError, ValueError):
        return tomli_w.dumps(document)
    return None


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
        condition, claim = (as_text(make(rng, tree), tree, names) for make in (random_condition, self._claim))
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
                    terminal(f"{verdict.words}")
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

    @staticmethod
    def _claim(rng: np.random.Generator, tree: DecisionTree) -> Any:
        return random_claim(rng, tree)


def as_argument(word: str) -> str | None:
    """A word as the shell can give it to a program; None where it cannot."""
    with contextlib.suppress(UnicodeEncodeError):
        return None if "\x00" in word else os.fsdecode(os.fsencode(word))
    return None


class Runs:
    """Folders of runs: (command, other changed files, changed file, its content)."""

    files = ("config.toml", "metrics.csv", "policy.json", "summary.json", "start.json", "safety.toml")
    outputs = (
        *("report.html", ".report.html.tmp", "tree.svg", "tree.pdf", "tree.onnx", ".metrics.csv.tmp"),
        *(".policy.json.tmp", ".config.toml.tmp", "episode.gif", "checkpoints/foreign.json", "policy.py"),
    )
    commands: ClassVar[dict[tuple[str, ...], int]] = {
        ("show", "run"): 12,
        ("load",): 12,
        ("verify", "run"): 4,
        ("explain", "run", "--observation", "0", "0", "0.1", "0"): 3,
        ("eval", "run", "--episodes", "1"): 4,
        ("diff", "run", "tree.json", "--episodes", "1"): 3,
        ("resume", "run"): 10,
        ("train", "CartPole-v1", "--run-dir", "run"): 1,
        ("train", "CartPole-v1", "--run-dir", "run", "--overwrite"): 2,
        ("train", "CartPole-v1", "--run-dir", "new", "--start", "run"): 2,
        ("report", "run", "--episodes", "1"): 2,
        ("compare", "run", "mlp", "--episodes", "1"): 1,
        ("watch", "run", "--max-steps", "2"): 0,
        ("pareto", "CartPole-v1", "--teacher", "run", "--out", "front"): 1,
        ("tune", "CartPole-v1", "--preset", "run/config.toml"): 1,
        **{("export", "run", "--to", to): 1 for to in (*FORMATS, "svg", "pdf")},
    }

    def __init__(self, scratch: Path) -> None:
        self.box = Box(scratch)
        self.run = {
            name.removeprefix("run/"): content
            for name, content in self.box.files.items()
            if name.startswith("run/")
        }
        self.sealed = sorted(name for name in self.run if name.startswith("checkpoints/"))

    def make(self, dice: Random) -> tuple[tuple[str, ...], dict[str, Content], str, Content]:
        """Change a file or two."""
        command = dice.choices([*self.commands], weights=[*self.commands.values()])[0]
        others: dict[str, Content] = {}
        for _ in range(dice.choice((0, 0, 0, 0, 1, 2))):
            name = self._name(dice)
            others[name] = self._changed(dice, name, others)
        name = self._name(dice)
        return command, others, name, self._changed(dice, name, others)

    def ask(self, given: tuple[tuple[str, ...], dict[str, Content], str, Content]) -> bool:
        """Run the command on the folder."""
        command, others, name, content = given
        changes = {f"run/{other}": its for other, its in {**others, name: content}.items()}
        self.box.fill(changes)
        rows = self._rows()
        answered = self.box.run(command, self._load if command == ("load",) else None)
        if command[0] == "resume" and not any(name.startswith("checkpoints") for name in (*others, name)):
            self._kept(rows)
        return answered

    def _name(self, dice: Random) -> str:
        which = dice.random()
        if which < 0.75:
            return dice.choice(self.files)
        return dice.choice(self.sealed) if which < 0.93 else dice.choice(self.outputs)

    def _changed(self, dice: Random, name: str, others: dict[str, Content]) -> Content:
        was = self.run.get(name, b"")
        how = dice.random()
        if how < 0.12 or name in self.outputs:
            outside = "../../outside"
            up = "../" * name.count("/")
            return dice.choice(
                (
                    *(None, b"", Folder(), Link(f"{up}{outside}/precious.txt"), Link(Path(name).name)),
                    *(Link(f"{up}{outside}/precious.json"), Link(f"{up}missing"), was[: len(was) // 2]),
                    *(b"\xef\xbb\xbf" + was, was.decode("latin-1").encode("utf-16"), b"\xff\x00" + was),
                    *(was.replace(b"\n", b"\r\n"), b"a" * 2_000_000, b"[" * 2_000_000, was * 200),
                )
            )
        if name.endswith(".safetensors"):
            others[name.replace(".safetensors", ".json")] = None
            changed = self._tensors(dice, was)
            step = int(Path(name).stem)
            seal = {"timestep": step, "sha256": hashlib.sha256(changed).hexdigest()}
            others[name.replace(".safetensors", ".json")] = json.dumps(seal).encode()
            return changed
        text = was.decode()
        if name.endswith(".json") and how < 0.6:
            return json.dumps(changed_document(dice, json.loads(text))).encode()
        if name.endswith(".toml") and how < 0.6:
            return as_bytes(_as_toml(changed_document(dice, tomllib.loads(text))) or "")
        if name == "config.toml" and dice.random() < 0.1:
            env = dice.choice((f"{EVIL}:CartPole-v1", f"{EVIL}:X-v0", "json:X-v0", "CartPole-v0", "\x1b[31m"))
            return text.replace('"CartPole-v1"', json.dumps(env)).encode()
        return as_bytes(
            changed_text(dice, text, ("CartPole-v1", f"{EVIL}:CartPole-v1", "[run]", "format = 1"))
        )

    @staticmethod
    def _tensors(dice: Random, content: bytes) -> bytes:
        """Change the header or the numbers; the checksum beside it is made to fit."""
        (length,) = struct.unpack("<Q", content[:8])
        header, numbers = content[8 : 8 + length].decode(), content[8 + length :]
        if dice.random() < 0.3:
            numbers = bytes(
                dice.choice((b ^ 255, b)) for b in numbers[: dice.choice((10, 1000, len(numbers)))]
            )
        elif dice.random() < 0.5:
            header = json.dumps(changed_document(dice, json.loads(header)))
        else:
            header = changed_text(dice, header)
        written = as_bytes(header)
        length = len(written) if dice.random() < 0.9 else dice.choice((0, 1, 2**63, 2**40))
        return struct.pack("<Q", length) + written + numbers

    def _load(self) -> Any:
        """As Python does it; None where it is refused."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                agent = sympol.load("run")
                rows = Run.open(Path("run")).metrics.read()
                if agent.state is not None:
                    agent.predict(np.zeros((2, len(agent.spec.features.names)), np.float32))
                return rows
            except (RunError, ValueError, EnvironmentFailure, ImportError, OSError, gymnasium.error.Error):
                return None

    def _rows(self) -> list[bytes]:
        path, was = self.box.work / "run/metrics.csv", self.run["metrics.csv"]
        content = path.read_bytes() if path.is_file() and not path.is_symlink() else b""
        return [line for line in content.splitlines() if line in was.splitlines()[1:]]

    def _kept(self, rows: Sequence[bytes]) -> None:
        """Raise Broken where numbers of a row are gone: the last checkpoint is later than all."""
        paths = [
            path for path in (self.box.work / "run").glob("*") if "metrics" in path.name and path.is_file()
        ]
        there = [set(line.split(b",")) for path in paths for line in path.read_bytes().splitlines()]
        if lost := [row for row in rows if not any(set(row.split(b",")) <= line for line in there)]:
            raise Broken("resume loses rows of metrics.csv", repr(lost))


class Flags:
    """What a command is told: (its words)."""

    kinds: ClassVar[dict[str, type]] = {
        "train": arguments.Train,
        "resume": arguments.Resume,
        "show": arguments.Show,
        "eval": arguments.Eval,
        "watch": arguments.Watch,
        "bench": arguments.Bench,
        "distill": arguments.Distill,
        "tune": arguments.Tune,
        "pareto": pareto.Pareto,
        "verify": verify.Verify,
        "explain": explain.Explain,
        "diff": diff.Diff,
        "export": export.Export,
        "report": report.Report,
        "compare": report.Compare,
    }
    valid: ClassVar[dict[str, tuple[str, ...]]] = {
        "train": ("CartPole-v1", "--run-dir", "new"),
        "resume": ("run",),
        "show": ("run",),
        "eval": ("run", "--episodes", "1"),
        "watch": ("run", "--max-steps", "2"),
        "bench": ("control-ppo", "--list"),
        "distill": ("mlp", "--episodes", "1", "--iterations", "1", "--eval-episodes", "1"),
        "tune": ("CartPole-v1",),
        "pareto": ("CartPole-v1",),
        "verify": ("run",),
        "explain": ("run", "--observation", "0", "0", "0.1", "0"),
        "diff": ("run", "tree.json"),
        "export": ("run", "--to", "text"),
        "report": ("run", "--episodes", "1"),
        "compare": ("run", "mlp", "--episodes", "1"),
    }
    slow = ("watch", "bench", "distill")
    integers = (*("0", "1", "2", "3", "-1", "7", "1000", "1e6", "1.5", "abc", "0x10", "1_0", "", "١", "3"),)
    huge = ("2147483648", "9223372036854775808", "9" * 30, "9" * 5000)
    floats = (*("0", "0.5", "1", "-1", "1e-9", "1e999", "nan", "inf", "-inf", "1e39", "abc", ""),)
    paths = (
        *(
            "run",
            "mlp",
            "run/policy.json",
            "tree.json",
            "tree.txt",
            "missing",
            "folder",
            "note.txt",
            "new",
            "",
        ),
        *(
            ".",
            "run/config.toml",
            "a" * 300,
            "new/deeper/x",
            "x\udcff",
            "tree.json/x",
            "run/checkpoints",
            "-",
        ),
        *("out.html", "out.txt", "out.png", "out.0.1", "out.gif", "\x1b[31mred", "new.toml", "missing.json"),
    )
    strings = (
        *(
            "CartPole-v1",
            "Pendulum-v1",
            "MiniGrid-Empty-5x5-v0",
            "cartpole-v1",
            "No-v0",
            ":",
            "a:b",
            "x=1",
            "=1",
        ),
        *(
            "json:X-v0",
            "CartPole-v1:",
            "FrozenLake-v1",
            "pole angle > 0.1",
            "pole angle=0.1",
            "cart position",
        ),
        *("when pole angle > 0.1 then action is push right", "5m", "50M steps", "-1m", "1e9h", "1e400 steps"),
        *(
            "paper",
            "default",
            "tree",
            "tree-paper",
            "viper-5",
            "all",
            "control-ppo",
            "static-batch",
            "python",
            "c",
        ),
        *("is_slippery=False", "view_size=5", "size=[1,2", "a=" + "[" * 3000, "sutton_barto_reward=true"),
        *(
            "render_mode=rgb_array",
            "0.1",
            "1",
            "\x1b[31m",
            "[bold]x",
            "mine=missing:train",
            "a" * 3000,
            "svg",
        ),
    )

    def __init__(self, scratch: Path) -> None:
        self.box = Box(scratch)

    def make(self, dice: Random) -> tuple[list[str]]:
        """Add flags to what is right, and change words."""
        command = dice.choice([*self.kinds])
        if command in self.slow and dice.random() < 0.8:
            command = dice.choice([name for name in self.kinds if name not in self.slow])
        words = [command, *self.valid[command]]
        for _ in range(dice.choice((0, 1, 1, 2, 3))):
            words += self._flag(dice, command)
        if dice.random() < 0.3:
            words = changed_list(dice, words)
        if dice.random() < 0.3:
            at = dice.randrange(len(words))
            words[at] = changed_text(dice, words[at], self.strings)
        given = map(as_argument, words)
        return ([word for word in given if word is not None and not _leads_away(word)],)

    def ask(self, given: tuple[list[str]]) -> bool:
        """Run it."""
        (words,) = given
        if not words or any(map(_leads_away, words)):
            return False
        self.box.fill({})
        return self.box.run(words)

    def _flag(self, dice: Random, command: str) -> list[str]:
        kinds = (self.kinds[command], Config) if command == "train" else (self.kinds[command],)
        hints = {name: hint for kind in kinds for name, hint in typing.get_type_hints(kind).items()}
        name = dice.choice([name for name in hints if name != "config"])
        flag = "--" + name.replace("_", "-")
        values = self._values(dice, hints[name])
        if len(values) == 1 and dice.random() < 0.2:
            return [f"{flag}={values[0]}"]
        return [flag, *values]

    def _values(self, dice: Random, hint: Any) -> list[str]:
        if get_origin(hint) in (typing.Union, types.UnionType):
            hint = dice.choice([one for one in get_args(hint) if one is not type(None)])
        if get_origin(hint) is tuple:
            return [
                value
                for _ in range(dice.choice((0, 1, 2, 3)))
                for value in self._values(dice, get_args(hint)[0])
            ]
        if get_origin(hint) is Literal:
            return [dice.choice((*get_args(hint), *get_args(hint), "none", ""))]
        if hint is bool:
            return [] if dice.random() < 0.9 else ["true"]
        if hint is int:
            return [dice.choice(self.huge if dice.random() < 0.1 else self.integers)]
        choices = {float: self.floats, Path: self.paths}.get(hint, self.strings)
        return [dice.choice(choices if dice.random() < 0.9 else self.strings)]


def _leads_away(word: str) -> bool:
    """Whether a word may name a place beyond the folder; a fuzzer had better not write there."""
    return re.search(r"(^|[=\s])[/~]|\.\.", word) is not None


class Observations:
    """Observations for agents and trees of every space: (number of the world, call, observation)."""

    def __init__(self, scratch: Path) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self.agents = [_acting(*world) for world in _worlds()]
            self.mlp = sympol.load(Box(scratch).made / "mlp")
        self.agents.append(self.mlp)

    def make(self, dice: Random) -> tuple[int, str, Any]:
        """Draw an observation that the space has, and change a part of it."""
        which = dice.randrange(len(self.agents))
        space = self.agents[which].spec.observation_space
        space.seed(dice.getrandbits(31))
        call = dice.choice(("agent",) * 6 + ("sampled", "tree", "apply", "proba", "flat"))
        observation = space.sample()
        if dice.random() < 0.3:
            batch = [space.sample() for _ in range(dice.choice((0, 1, 2, 3)))]
            observation = _stacked(observation, batch)
        if call in ("tree", "apply", "proba", "flat"):
            with contextlib.suppress(ValueError):
                observation = self.agents[which].spec.features.flatten(observation)
        if dice.random() < 0.85:
            observation = _changed_part(dice, observation)
        return which, call, observation

    def ask(self, given: tuple[int, str, Any]) -> bool:
        """Act on it."""
        which, call, observation = given
        agent = self.agents[which]
        allowed = (ValueError, TypeError) if call in ("tree", "apply", "proba") else (ValueError,)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.simplefilter("error", RuntimeWarning)
            try:
                if call in ("agent", "sampled", "flat"):
                    space = agent.spec.observation_space
                    valid = call == "agent" and _contains(space, observation)
                    try:
                        action, _ = agent.predict(observation, deterministic=call != "sampled")
                    except ValueError as error:
                        if valid:
                            kind = f"{type(space).__name__} contains {type(observation).__name__}, which is refused"
                            raise Broken(kind, str(error)) from error
                        raise
                    if valid and not agent.spec.action_space.contains(action):
                        raise Broken("an action that the space has not", repr(action))
                elif agent.has_tree:
                    tree = agent.tree()
                    {"tree": tree.predict, "apply": tree.apply, "proba": tree.predict_proba}[call](
                        observation
                    )
            except allowed:
                return False
        return True


def _worlds() -> list[tuple[gymnasium.Space, gymnasium.Space]]:
    observed = [
        BoxSpace(-1, 1, (3,)),
        BoxSpace(-np.inf, np.inf, (2, 2), np.float64),
        BoxSpace(0, 255, (2, 2, 1), np.uint8),
        BoxSpace(-5, 5, (2,), np.int32),
        BoxSpace(-1, 1, (), np.float32),
        BoxSpace(-1, 1, (1,), np.float16),
        Discrete(4),
        Discrete(3, start=-1),
        MultiDiscrete([2, 3]),
        MultiDiscrete([[2, 3], [2, 2]]),
        MultiBinary(3),
        MultiBinary((2, 2)),
        Dict({"a": BoxSpace(-1, 1, (2,)), "b": Discrete(3), "c": MultiBinary(2)}),
        Dict(
            {
                "x": Dict({"y": BoxSpace(0, 1, (1,)), "z": Discrete(2)}),
                "w": Tuple([Discrete(2), MultiBinary(1)]),
            }
        ),
        Tuple([BoxSpace(-1, 1, (2,)), Discrete(2), Dict({"k": MultiDiscrete([2, 2])})]),
    ]
    acted = [
        *(Discrete(3), Discrete(2, start=1), MultiDiscrete([2, 3]), BoxSpace(-1, 1, (2,))),
        *(BoxSpace(-2, 2, (1, 2), np.float64), BoxSpace(-np.inf, np.inf, (1,))),
    ]
    return [(space, acted[i % len(acted)]) for i, space in enumerate(observed)]


def _acting(observed: gymnasium.Space, acted: gymnasium.Space) -> Any:
    """An agent that acts by a tree, and has not learnt."""
    env = Chain(observed, acted)
    spec = sympol.resolve(env)
    n, rng = len(spec.features.names), np.random.default_rng(0)
    tree = DecisionTree.from_complete(
        rng.integers(n, size=3),
        np.full(3, 0.5, np.float32),
        rng.normal(size=(4, spec.actions.n_outputs)),
        actions=spec.actions,
        **spec.features.reading(),
    )
    return sympol.PPO("tree", env, start=tree, depth=2)


def _contains(space: gymnasium.Space, observation: Any) -> bool:
    try:
        return bool(space.contains(observation))
    except Exception:
        return False


def _stacked(like: Any, batch: list[Any]) -> Any:
    """Samples with a leading axis on every array, as in Gymnasium's vector environments."""
    if isinstance(like, dict):
        return {key: _stacked(part, [one[key] for one in batch]) for key, part in like.items()}
    if isinstance(like, tuple):
        return tuple(_stacked(part, [one[i] for one in batch]) for i, part in enumerate(like))
    array = np.asarray(like)
    return np.array(batch, array.dtype).reshape(len(batch), *array.shape)


def _changed_part(dice: Random, observation: Any) -> Any:
    if isinstance(observation, dict) and dice.random() < 0.8:
        changed = dict(observation)
        key = dice.choice([*changed])
        match dice.randrange(6):
            case 0:
                changed.pop(key)
            case 1:
                changed[dice.choice(("new", 1, None, ("a",), "a.b"))] = 0
            case 2:
                changed[dice.choice((1, f"{key} ", key.upper()))] = changed.pop(key)
            case _:
                changed[key] = _changed_part(dice, changed[key])
        return changed
    if isinstance(observation, tuple) and dice.random() < 0.8:
        parts = [*observation]
        at = dice.randrange(len(parts))
        match dice.randrange(5):
            case 0:
                return parts
            case 1:
                parts.pop(at)
            case 2:
                parts.append(parts[at])
            case _:
                parts[at] = _changed_part(dice, parts[at])
        return tuple(parts)
    if isinstance(observation, dict | tuple) or dice.random() < 0.25:
        return dice.choice(_ODD)()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return dice.choice(_ARRAY_CHANGES)(dice, np.asarray(observation))


def _looped() -> list[Any]:
    loop: list[Any] = []
    loop.append(loop)
    return loop


_ODD: tuple[Callable[[], Any], ...] = (
    *(lambda: None, lambda: True, lambda: 0, lambda: 1.5, lambda: "x", lambda: b"x", lambda: "", lambda: []),
    *(lambda: {}, lambda: (), lambda: set(), lambda: object(), lambda: 10**400, lambda: -1, lambda: 2**63),
    *(lambda: float("nan"), lambda: float("inf"), lambda: 1j, lambda: [[1, 2], [3]], lambda: [None, 1]),
    *(
        lambda: iter([1, 2]),
        lambda: range(3),
        lambda: np.float64,
        lambda: np.array("x"),
        lambda: np.array(None),
    ),
    *(lambda: np.datetime64("2020-01-01"), lambda: np.zeros((0, 3)), lambda: np.zeros((3, 0)), _looped),
    *(lambda: np.zeros(3, "f4,i4"), lambda: np.bool_(True), lambda: np.int64(1), lambda: np.zeros((1,) * 32)),
    *(
        lambda: np.uint64(2**64 - 1),
        lambda: [10**400] * 3,
        lambda: ["a", 1.0],
        lambda: {"a": {}},
        lambda: [{}],
    ),
)
"""Each makes what is no observation of most spaces."""

_DTYPES = (
    "f2",
    "f4",
    "f8",
    "g",
    "c8",
    "?",
    "u1",
    "i1",
    "i2",
    "i4",
    "i8",
    "u8",
    "O",
    "U8",
    "S8",
    "M8[s]",
    ">f4",
    ">i8",
)
_ARRAY_CHANGES: tuple[Callable[[Random, np.ndarray], Any], ...] = (
    lambda dice, x: x.astype(dice.choice(_DTYPES)),
    lambda dice, x: x.astype(dice.choice(_DTYPES)),
    lambda dice, x: x.tolist(),
    lambda dice, x: [*x] if x.ndim else [x],
    lambda dice, x: x[None],
    lambda dice, x: x[..., None],
    lambda dice, x: np.array([x] * dice.choice((0, 1, 2, 5))),
    lambda dice, x: np.resize(
        x, dice.choice(((), (0,), (1,), (2,), (3,), (4,), (2, 2), (0, 3), (5, 3), (2, 3, 4)))
    ),
    lambda dice, x: x.ravel(),
    lambda dice, x: x.T,
    lambda dice, x: np.full_like(x, dice.choice((0, 1, 2, 7)), dtype=dice.choice(("f4", "i8", "f8"))),
    lambda dice, x: np.full(x.shape, dice.choice((np.nan, np.inf, -np.inf, 1e300, -1e39, 1e-45, -0.0, 1e19))),
    lambda dice, x: np.full(x.shape, dice.choice((-1, 2**31, 2**53, 2**63 - 1, -(2**63))), "i8"),
    lambda dice, x: np.full(x.shape, 2**64 - 1, "u8"),
    lambda dice, x: x.astype("f8") * dice.choice((-1, 1e30, 1e300, 0.3)),
    lambda dice, x: np.ma.masked_array(x, mask=np.ones(x.shape, bool)),
    lambda dice, x: np.asfortranarray(x)[::-1] if x.ndim else x,
    lambda dice, x: tuple(x.ravel().tolist()),
    lambda dice, x: {"x": x},
    lambda dice, x: np.array([x, None], object)[:1],
    lambda dice, x: x.item() if x.size == 1 else x.tolist(),
)

CLASSES: dict[str, Callable[[Path], Fuzzer]] = {
    "json": Json,
    "text": Text,
    "properties": Properties,
    "runs": Runs,
    "flags": Flags,
    "observations": Observations,
}
