"""The command line, ``sympol``: one line for each command here, and one module beside it.

A command's module holds its arguments and a function ``run``, which takes the words after the command's name and
returns the exit status. Modules are imported when their command runs, and import only what its arguments need. What
plays, draws or trains is imported where it is used, so that reading a tree waits for neither JAX nor Matplotlib.
"""

from __future__ import annotations

import difflib
import logging
import signal
import sys
from collections.abc import Sequence
from importlib import import_module

from ..interrupts import interrupts, say
from ..terminal import write_readable_ascii

_INTERRUPTED = {128 + signal.SIGINT, 128 + signal.SIGTERM}

COMMANDS = {
    "train": ("CartPole-v1", "train a tree, print it and save it in a folder, the run"),
    "check": ("tank.py:Tank", "say what sympol sees of an environment, and what is wrong with it"),
    "show": ("RUN", "print the tree of a run"),
    "eval": ("RUN", "play test episodes on Gymnasium"),
    "watch": ("RUN", "film an episode beside the tree, its path highlighted"),
    "export": ("RUN", "write the tree as a program (Python, C, Rust, JavaScript, SQL), a model or a picture"),
    "report": ("RUN", "write a web page: the tree, episodes, sliders, returns; it opens from disk"),
    "compare": ("RUN RUN ...", "write a web page: several policies on the same episodes"),
    "verify": ("RUN", "prove what the policy always does or never does, or find where it does not"),
    "explain": ("RUN", "explain an action in one state, and what would change it"),
    "diff": ("RUN RUN", "list how two trees differ, and in which states"),
    "resume": ("RUN", "continue an interrupted training"),
    "distill": (
        "TEACHER",
        "distill an MLP, a soft tree, a stable-baselines3 model or a function into a tree",
    ),
    "pareto": ("CartPole-v1", "search the best small trees: return against size"),
    "bench": ("TABLE", "run what a table of the paper lacks, and write it: control-ppo, minigrid, ..."),
    "tune": ("CartPole-v1", "search hyperparameters; the best become a preset"),
}
"""Each command's arguments and purpose; its module has its name."""


def usage() -> str:
    """Return the help of ``sympol``."""
    calls = {f"sympol {name} {arguments}": purpose for name, (arguments, purpose) in COMMANDS.items()}
    width = max(map(len, calls))
    listed = "\n".join(f"  {call:<{width}}  {purpose}" for call, purpose in calls.items())
    return f"""\
sympol: reinforcement learning whose policy is a decision tree you can read

{listed}

Each has --help. `sympol --import MODULE COMMAND ...` first imports a module or a file of yours, which may
register environments, adapters and algorithms.

Environments: a class, a function or an id in a file or module of yours (tank.py:Tank, my_package:make_tank,
my_package:Tank-v0), or any Gymnasium id. CartPole-v1, Acrobot-v1, Pendulum-v1, MountainCar-v0,
MountainCarContinuous-v0 and most of MiniGrid (MiniGrid-DoorKey-5x5-v0, ...) train inside one compiled
program, LunarLander-v3 in machine code.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: The words after ``sympol``. By default those of the process, which is then the command's own: Ctrl-C ends
            it at any moment.

    Returns:
        The exit status: 0 after success, 1 after a failure, 2 after bad input, 130 after Ctrl-C.
    """
    if argv is not None:
        return _run(list(argv))
    interrupts.listen()
    # without a home Matplotlib has no cache, which nobody needs to be told
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    try:
        status = _run(sys.argv[1:])
    except SystemExit as stop:
        if stop.code not in _INTERRUPTED:
            raise
        status = stop.code
    except BaseException:
        if not interrupts.at_once:
            raise
        if interrupts.take_last_word():
            say("interrupted")
        status = interrupts.status
    if status in _INTERRUPTED:
        interrupts.leave(status)
    return status


def _run(words: list[str]) -> int:
    write_readable_ascii()
    if not words or words[0] in ("-h", "--help", "help"):
        print(usage(), end="")
        return 0
    if words[0] == "--version":
        from ..version import __version__

        print(f"sympol {__version__}")
        return 0
    modules = []
    while words and words[0] == "--import":
        modules, words = [*modules, *words[1:2]], words[2:]
    name = words[0] if words else ""
    if name not in COMMANDS:
        near = difflib.get_close_matches(name, COMMANDS)
        hint = f"did you mean {' or '.join(near)}?" if near else f"there are {', '.join(COMMANDS)}"
        print(f"error: unknown command {name!r}; {hint}", file=sys.stderr)
        return 2
    from .console import one_line_errors

    with interrupts.heard(lambda number: True), one_line_errors():  # from here on there may be files to close
        for module in modules:
            _import(module)
        return import_module(f".{name}", __package__).run(words[1:])


def _import(module: str) -> None:
    """Import a module that the user named, from the working directory or elsewhere on the path, or a file."""
    from ..envs.user_code import CodeNotFound, import_code

    try:
        import_code(module)
    except CodeNotFound as error:
        raise CodeNotFound(f"--import {module}: {error}") from error


if __name__ == "__main__":
    sys.exit(main())
