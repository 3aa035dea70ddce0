"""Cells of a MiniGrid as integers: the bits of their one-hot encoding.

Farama's package shows a cell as three numbers (object, colour, state), and its ``OneHotPartialObsWrapper`` turns
them into 11 + 6 + 3 = 20 planes. Here a cell is an int32 whose bit p is plane p, so that a plane is one shift
away, and a question such as "does it block the way?" is one mask.
"""

from __future__ import annotations

OBJECTS = ("unseen", "empty", "wall", "floor", "door", "key", "ball", "box", "goal", "lava", "agent")
COLOURS = ("red", "green", "blue", "purple", "yellow", "grey")
STATES = ("open", "closed", "locked")
ACTIONS = ("turn left", "turn right", "move forward", "pick up", "drop", "toggle", "done")
"""Names of the actions, in the order of the numbers that Farama's package gives them."""

LEFT, RIGHT, FORWARD, PICK_UP, DROP, TOGGLE, DONE = range(len(ACTIONS))

KINDS = {
    "": range(len(OBJECTS)),
    "colour": range(len(OBJECTS), len(OBJECTS) + len(COLOURS)),
    "state": range(len(OBJECTS) + len(COLOURS), len(OBJECTS) + len(COLOURS) + len(STATES)),
}
"""The planes of each kind; of every kind, exactly one is 1 in a cell."""

PLANES = (*OBJECTS, *COLOURS, *STATES)
"""Names of the planes, by number."""


def bits(*planes: str) -> int:
    """Return the integer in which the bits of some planes are set.

    Args:
        planes: Names of the planes.

    Returns:
        The integer.
    """
    return sum(1 << PLANES.index(plane) for plane in planes)


def cell(what: str, colour: str = "red", state: str = "open") -> int:
    """Return an object as the bits of its one-hot encoding.

    Args:
        what: The object.
        colour: Its colour.
        state: Its state; MiniGrid calls everything open that is not a closed door.

    Returns:
        The integer.
    """
    return bits(what, colour, state)


UNSEEN = cell("unseen")
EMPTY = cell("empty")
WALL = cell("wall", "grey")
GOAL = cell("goal", "green")
LAVA = cell("lava")

PORTABLE = bits("key", "ball", "box")
BLOCKS_WAY = PORTABLE | bits("wall", "closed", "locked")
BLOCKS_SIGHT = bits("wall", "closed", "locked")

CARRIED = tuple(cell(what, colour) for what in ("key", "ball", "box") for colour in COLOURS)
ANYTHING = tuple(
    cell(what, colour, state) for what in OBJECTS if what != "agent" for colour in COLOURS for state in STATES
)
"""Every code that a cell can have in any task; the agent itself is never shown."""
