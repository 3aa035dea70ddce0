"""What each command may be told."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from ..algorithms.config import Config
from ..algorithms.presets import DEFAULT
from ..envs.spec import Backend

Text = tyro.conf.Positional[str]
Folder = tyro.conf.Positional[Path]


@dataclass(kw_only=True)
class PlaysRun:
    """Arguments of commands that play episodes of a run that is there."""

    env: str | None = None
    """The environment, where the run's folder cannot make it: an id, or module:Id, whose module is imported."""

    trust: bool = False
    """Import the module that the run's folder names, which runs its code."""


@dataclass
class Train:
    """Train a decision tree (or a rival: --policy) by PPO (or A2C: --algorithm) and keep everything in one folder."""

    env: Text
    """Gymnasium id, such as CartPole-v1."""

    seed: int = 0
    """Of everything random; the same seed on the same machine gives the same tree."""

    preset: str = DEFAULT
    """Where the hyperparameters come from: default (ours), paper, or the path of a .toml file (sympol tune)."""

    run_dir: Path | None = None
    """The run's folder; by default the next free one under runs/."""

    overwrite: bool = False
    """Replace the run that is in --run-dir."""

    resume: bool = False
    """Go on with the run that is in --run-dir."""

    env_kwargs: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=VALUE ...")] = ()
    """What to make the environment with, such as view_size=5 or continuous=true."""

    backend: Backend = "auto"
    """jax: inside the compiled program; native: our own machine code; host: through Gymnasium; auto: the first of
    these that there is."""

    start: Path | None = None
    """A tree to train on from: a run's folder, or a policy.json (edited, written by hand). --depth is by default that
    of the preset or, where that is less, of the tree."""

    freeze_nodes: tuple[int, ...] = ()
    """Nodes of the tree to start from that stay as they are, numbered as in policy.json, from 0, the root."""

    freeze: str | None = None
    """A condition, such as "pole angle > 0.1 and cart velocity > 0": wherever it holds, what is done stays what the
    tree to start from does."""

    start_confidence: float = 0.7
    """How probable the action of a leaf is made at first where the tree to start from is all but sure of it."""

    critic_warmup: float = 0.05
    """The part of a training that starts from a tree in which only the critic learns."""

    eval_episodes: int = 20
    """Test episodes on Gymnasium at the end."""

    tensorboard: bool = False
    """Write TensorBoard logs into the run, too."""

    json: bool = False
    """Print the summary as one line of JSON and nothing else on the standard output."""

    config: Annotated[Config, tyro.conf.arg(name="")] = field(default_factory=Config)


@dataclass
class Resume(PlaysRun):
    """Go on with an interrupted training; it ends in the tree it would have ended in."""

    run: Folder
    """The run's folder."""

    eval_episodes: int | None = None
    """Test episodes on Gymnasium at the end; by default as many as the training was told."""

    json: bool = False
    """One line of JSON."""


@dataclass
class Eval(PlaysRun):
    """Play test episodes with a run's tree, on Gymnasium itself."""

    run: Folder
    """The run's folder."""

    episodes: int = 100
    """How many."""

    seed: int = 7
    """Another seed, other episodes."""

    json: bool = False
    """One line of JSON."""


@dataclass
class Show(PlaysRun):
    """The tree of a run, as text, and what it earns."""

    run: Folder
    """The run's folder."""


@dataclass
class Watch(PlaysRun):
    """A film of test episodes on Gymnasium: what happens, and beside it the tree with the way taken lit."""

    run: Folder
    """The run's folder."""

    episodes: int = 1
    """How many, one after another."""

    seed: int = 7
    """Another seed, other episodes; they are those of sympol eval."""

    out: Path | None = None
    """What to write: .gif, .webp, or .mp4; RUN/episode.gif by default."""

    fps: float | None = None
    """Steps a second; by default the environment's own pace, slower where there are few."""

    max_steps: int | None = None
    """Cut episodes there."""


@dataclass
class Bench:
    """Run what a table lacks, and write it: Markdown, LaTeX, CSV and plots, the paper's numbers beside ours.

    Each cell is some trainings, ordinary run folders, and ends as one small file in ROOT/results/cells. A finished
    cell is never run again unless its config has changed; what was interrupted (Ctrl-C) goes on where it was.

    What there is to do, and what it would take the place of: sympol bench control-ppo --list

    The paper's first table on two processors: sympol bench control-ppo --workers 2

    Your environment: sympol bench control-ppo --environments my_package:My-v0

    Your method beside ours: sympol bench control-ppo --methods tree mlp mine=my_package.method:train
    """

    table: Annotated[Text, tyro.conf.arg(metavar="TABLE")]
    """control-ppo, control-a2c, ppo-vs-a2c, minigrid, information-loss, viper-control, viper-minigrid, tree-size,
    ablation, runtime, training-curves, or all."""

    environments: tuple[str, ...] = ()
    """Only these, or others in their place: any Gymnasium id."""

    methods: tuple[str, ...] = ()
    """Only these, or others in their place: tree, mlp, sdt, d-sdt, sa-dt-5, sa-dt-8, viper-5, viper-8, dagger-5,
    dagger-8, tree-paper, mlp-paper, sdt-paper; NAME=MODULE:FUNCTION for one of your own."""

    variants: tuple[str, ...] = ()
    """Only these ablations, such as static-batch."""

    trainings: int = 5
    """Of each cell; their seeds are 0, 1, ..."""

    episodes: int = 100
    """Test episodes of each training on Gymnasium; as many in which actions are sampled, and for validation."""

    total_timesteps: int = 1_000_000
    """Environment steps of each training."""

    workers: int = 1
    """Processes on this machine."""

    scheduler: str | None = None
    """Address of a Dask scheduler whose workers do the work, such as tcp://host:8786."""

    root: Path = Path()
    """Where results/cells, results/tables, runs/bench and docs are."""

    runs: Path | None = None
    """Where run folders are kept; ROOT/runs/bench by default."""

    out: Path | None = None
    """Where tables are written; ROOT/results/tables by default."""

    imports: tuple[str, ...] = ()
    """Modules that register environments or methods of your own; workers import them, too."""

    list: bool = False
    """Say what is finished and what there is to run, and stop."""

    render_only: bool = False
    """Write the tables from the records there are, and run nothing."""


@dataclass
class Distill:
    """Make a tree of a policy that is none, keep it in a folder as a run is kept, and say what the two earn."""

    teacher: Text
    """A run's folder; the zip of a stable-baselines3 model; or module:function, from an observation to an action."""

    method: Literal["viper", "dagger", "sa-dt", "discretize"] | None = None
    """By default discretize for a soft tree, viper for a teacher whose actions have values, else dagger."""

    depth: int | None = None
    """Most comparisons before an answer: 5 by default, any number with --max-nodes; with discretize, the soft tree's
    own."""

    max_nodes: int | None = None
    """Most nodes, leaves among them, an odd number: the tree grows where that gains most."""

    env: str | None = None
    """Gymnasium id of where the teacher acts; a run knows its own, if its folder can make it."""

    env_kwargs: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=VALUE ...")] = ()
    """What to make --env with."""

    trust: bool = False
    """Unpickle the zip, or import the module that a run's folder names: either may run any code of its author."""

    seed: int = 0
    """The same seed gives the same tree."""

    episodes: int | None = None
    """What is learnt from: of viper and dagger in each iteration (10), of sa-dt in all (25)."""

    iterations: int | None = None
    """Trees that viper and dagger fit, of which they return the best (20)."""

    eval_episodes: int = 20
    """Test episodes on Gymnasium, the same for the tree and its teacher."""

    out: Path | None = None
    """The tree's folder; by default RUN/distilled/METHOD-DEPTH, or runs/ENV-METHOD-DEPTH, or METHOD-63-nodes."""

    overwrite: bool = False
    """Replace the run that is there."""

    json: bool = False
    """One line of JSON."""


@dataclass
class Tune:
    """Search hyperparameters for an environment and a policy: trials in the paper's grids, by validation returns.

    All is kept in a study; what was interrupted goes on, and more --trials add to it. Hopeless trials are pruned.

    The best as a preset: sympol tune CartPole-v1 --save-preset best.toml

    Training with it: sympol train CartPole-v1 --preset best.toml
    """

    env: Text
    """Gymnasium id, such as CartPole-v1."""

    policy: Literal["tree", "mlp", "sdt"] = "tree"
    """A decision tree, or a rival: a multilayer perceptron, a soft decision tree."""

    algorithm: Literal["ppo", "a2c"] = "ppo"
    """What trains it."""

    trials: int = 60
    """How many there are to be in the study, those of earlier calls included."""

    total_timesteps: int = 1_000_000
    """Environment steps of each training."""

    seeds: int = 1
    """Trainings of each trial; what counts is the mean of their validation returns."""

    seed: int = 1000
    """The first of these seeds, and that of the search itself; below 1000 are those that are reported."""

    preset: str = DEFAULT
    """What trials start from, in fields that are not searched: default, paper, or the path of a .toml file."""

    storage: str | None = None
    """A journal file, or postgresql://user@host/database; runs/tune/ENV-ALGORITHM-POLICY.journal by default."""

    study: str | None = None
    """What the study is called in the storage; ENV-ALGORITHM-POLICY by default."""

    workers: int = 1
    """Processes on this machine."""

    scheduler: str | None = None
    """Address of a Dask scheduler whose workers do the work, such as tcp://host:8786."""

    save_preset: Path | None = None
    """Write the best trial as a preset: a .toml file, for sympol train ENV --preset FILE."""

    env_kwargs: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=VALUE ...")] = ()
    """What to make the environment with."""
