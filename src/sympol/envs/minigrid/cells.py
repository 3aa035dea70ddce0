"""What a cell of a MiniGrid shows, as one integer: the bits of its one-hot encoding.

Farama's package shows a cell as three numbers (object, colour, state), and its ``OneHotPartialObsWrapper`` turns
them into 11 + 6 + 3 = 20 planes. Here a cell is an int32 whose bit p is plane p, so that a plane is one shift
away, and a question such as "does it block the way?" is one mask.
"""

from __future__ import annotations

OBJECTS = ("unseen", "empty", "wall", "floor", "door", "key", "ball", "box", "goal", "lava", "agent")
COLOURS = ("red", "green", "blue", "purple", "yellow", "grey")
STATES = ("open", "closed", "locked")
ACTIONS = ("turn left", "turn right", "move forward", "pick up", "drop", "toggle", "done")
"""In the order of the numbers that Farama's package gives them."""

LEFT, RIGHT, FORWARD, PICK_UP, DROP, TOGGLE, DONE = range(len(ACTIONS))

KINDS = {
    "": range(len(OBJECTS)),
    "colour": range(len(OBJECTS), len(OBJECTS) + len(COLOURS)),
    "state": range(len(OBJECTS) + len(COLOURS), len(OBJECTS) + len(COLOURS) + len(STATES)),
}
"""The planes of each kind; of every kind, exactly one is 1 in a cell."""

PLANES = (*OBJECTS, *COLOURS, *STATES)
"""What each plane says, by its number."""


def bits(*planes: str) -> int:
    """The integer in which the bits of these planes are set."""
    return sum(1 << PLANES.index(plane) for plane in planes)


def cell(what: str, colour: str = "red", state: str = "open") -> int:
    """An object as the bits of its one-hot encoding. MiniGrid calls everything open that is not a closed door."""
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
"""What any task could show in a cell; the agent itself is never shown."""
