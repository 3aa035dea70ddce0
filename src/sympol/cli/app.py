"""``sympol``: the command line.

The commands are thin: each parses its arguments, calls the verbs, and prints.
"""

from __future__ import annotations

import logging
import signal
import sys
from collections.abc import Callable, Sequence

from ..interrupts import interrupts, say
from ..terminal import write_readable_ascii

_INTERRUPTED = {128 + signal.SIGINT, 128 + signal.SIGTERM}

USAGE = """\
sympol: reinforcement learning whose policy is a decision tree you can read

  sympol train CartPole-v1     train a tree; it is shown at the end and kept in a folder, the run
  sympol show RUN              the tree of a run, as text
  sympol eval RUN              play test episodes on Gymnasium
  sympol watch RUN             a film of an episode, beside it the tree with the way taken lit
  sympol export RUN            the tree as a program (Python, C, Rust, JavaScript, SQL), a model or a picture
  sympol report RUN            a web page: the tree, episodes, sliders, returns; open it from disk
  sympol compare RUN RUN ...   a web page: several policies on the same episodes
  sympol verify RUN            prove what the policy always does, or never; find where it does not
  sympol explain RUN           why it acts as it does in one state, and what would make it act otherwise
  sympol diff RUN RUN          what is different between two trees, in words, and in the states one visits
  sympol resume RUN            go on with an interrupted training
  sympol distill TEACHER       make a tree of an MLP, a soft tree, a stable-baselines3 model or any function
  sympol pareto CartPole-v1    the best small trees: return against size, from which to choose
  sympol bench TABLE           run what a table of the paper lacks, and write it: control-ppo, minigrid, ...
  sympol tune CartPole-v1      search hyperparameters; the best become a preset

Each has --help. Environments: any Gymnasium id. CartPole-v1, Acrobot-v1, Pendulum-v1, MountainCar-v0,
MountainCarContinuous-v0 and most of MiniGrid (MiniGrid-DoorKey-5x5-v0, ...) train inside one compiled
program, LunarLander-v3 in machine code.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; return the exit status: 0 good, 1 failed, 2 bad input, 130 interrupted.

    Without ``argv`` the words are the process's own and the process is the command's: Ctrl-C ends it at any moment.
    """
    if argv is not None:
        return _run(list(argv))
    interrupts.listen()
    logging.getLogger("matplotlib").setLevel(
        logging.ERROR
    )  # without a home it keeps nothing, and need not say so
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


def _run(arguments: list[str]) -> int:
    write_readable_ascii()
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(USAGE, end="")
        return 0
    if arguments[0] == "--version":
        from .. import __version__

        print(f"sympol {__version__}")
        return 0
    from .commands import COMMANDS

    command: Callable[[Sequence[str]], int] | None = COMMANDS.get(arguments[0])
    if command is None:
        print(f"error: unknown command {arguments[0]!r}; there are {', '.join(COMMANDS)}", file=sys.stderr)
        return 2
    with interrupts.heard(lambda number: True):  # from here on there may be something to close
        return command(arguments[1:])


if __name__ == "__main__":
    sys.exit(main())
