"""The memory of a landing: records of float32, a row for each body, joint and contact.

Scalars of NumPy stand here so that compiled code has them as float32; a bare ``0.5`` there would be float64.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .machine import borrowed, compiled
from .shapes import BODIES, EDGES

F = np.float32
ZERO, HALF, ONE = F(0), F(0.5), F(1)
CONTACTS = 6
"""The most edges that a body can be near to."""
POINTS = 2
"""The most points of a contact."""
LANES = 16
"""Number of landings whose velocities are solved side by side, by instructions that take several numbers at once."""

BODY = np.dtype(
    [
        *((name, "f4") for name in ("cx", "cy", "angle")),  # centre of mass
        *((name, "f4") for name in ("vx", "vy", "spin")),
        *((name, "f4") for name in ("cx0", "cy0", "angle0", "alpha0")),  # where the sweep of this step begins
        *((name, "f4") for name in ("px", "py", "sin", "cos")),  # origin and rotation
        *((name, "f4") for name in ("low_x", "low_y", "high_x", "high_y")),  # its fat box
        ("sleep", "f4"),  # seconds at rest
        ("contacts", "i4"),
    ]
)
_HINGE = [
    *((name, "f4") for name in ("ix", "iy", "iz", "motor")),  # impulses, kept from step to step
    ("limit", "i4"),  # -1 at the lower, 1 at the upper, 0 between
    *((name, "f4") for name in ("ax", "ay", "bx", "by")),  # arms to the lander's and the leg's centre
    *((name, "f4") for name in ("kxx", "kxy", "kxz", "kyy", "kyz", "kzz", "det3", "det2")),
]
JOINT = np.dtype(_HINGE)
_SOLVED = [
    ("solved", "i4"),  # points that push; where there is no contact, none
    *((name, "f4") for name in ("wx", "wy", "friction", "k11", "k12", "k22", "m11", "m12", "m22")),
]
CONTACT = np.dtype(
    [
        ("edge", "i4"),
        ("touching", "i4"),
        ("points", "i4"),
        ("of_edge", "i4"),  # whether the edge is the face, and the body's corners are the points
        *((name, "f4") for name in ("nx", "ny", "px", "py")),  # normal and point of the face, in its frame
        ("enabled", "i4"),
        ("toi", "f4"),
        ("has_toi", "i4"),
        ("substeps", "i4"),
        *_SOLVED,
    ]
)
_PUSHED = [
    *((name, "f4") for name in ("normal", "tangent")),  # impulses
    *((name, "f4") for name in ("rx", "ry", "normal_mass", "tangent_mass")),
]
POINT = np.dtype(
    [
        *((name, "f4") for name in ("x", "y")),  # in the frame of what is not the face
        ("feature", "i4"),  # which corner and side; impulses of the same ones are kept
        *_PUSHED,
    ]
)
EDGE = np.dtype(
    [
        *((name, "f4") for name in ("x1", "y1", "x2", "y2", "nx", "ny", "friction")),
        *((name, "f4") for name in ("low_x", "low_y", "high_x", "high_y")),
    ]
)
GAME = np.dtype(
    [
        ("random", "u8"),  # state of the generator
        ("shaping", "f8"),
        ("begun", "i4"),
        ("crashed", "i4"),
        ("left", "i4"),  # legs on the ground
        ("right", "i4"),
        ("time", "i4"),
    ]
)
JOINT_LANES = np.dtype(
    [
        *((name, "f4", (BODIES, LANES)) for name in ("vx", "vy", "spin")),
        *((name, kind, (BODIES - 1, LANES)) for name, kind in _HINGE),
    ]
)
CONTACT_LANES = np.dtype(
    [
        *((name, kind, (LANES,)) for name, kind in _SOLVED),
        *((name, kind, (POINTS, LANES)) for name, kind in _PUSHED),
    ]
)


class Landing(NamedTuple):
    """The state of one episode, or with a leading axis of several."""

    bodies: Any
    """`BODY` [3]: the lander and its legs."""
    joints: Any
    """`JOINT` [2]"""
    contacts: Any
    """`CONTACT` [3, contacts], each body's newest first."""
    points: Any
    """`POINT` [3, contacts, 2]"""
    edges: Any
    """`EDGE` [11]: the level one below, then the ground from left to right."""
    game: Any
    """`GAME` [1]"""


def allocate_landings(number: int) -> Landing:
    """Allocate the memory for some episodes; `start` begins each."""
    return Landing(
        np.zeros((number, BODIES), BODY),
        np.zeros((number, BODIES - 1), JOINT),
        np.zeros((number, BODIES, CONTACTS), CONTACT),
        np.zeros((number, BODIES, CONTACTS, POINTS), POINT),
        np.zeros((number, EDGES), EDGE),
        np.zeros((number, 1), GAME),
    )


@compiled
def borrowed_landings(landings):
    """Return the landings, borrowed; see `machine.borrowed`."""
    return Landing(
        borrowed(landings.bodies),
        borrowed(landings.joints),
        borrowed(landings.contacts),
        borrowed(landings.points),
        borrowed(landings.edges),
        borrowed(landings.game),
    )


@compiled
def landing_at(landings, at):
    """Return one of several landings."""
    return Landing(
        landings.bodies[at],
        landings.joints[at],
        landings.contacts[at],
        landings.points[at],
        landings.edges[at],
        landings.game[at],
    )


class Lanes(NamedTuple):
    """The numbers from which velocities of up to `LANES` landings are solved; each stands beside those of the other
    landings."""

    joints: Any
    """`JOINT_LANES` [1]: bodies and joints."""
    contacts: Any
    """`CONTACT_LANES` [2, contacts]: the n-th contact of each leg that touches the ground."""


def allocate_lanes() -> Lanes:
    """Allocate the memory for `LANES` landings."""
    return Lanes(np.zeros(1, JOINT_LANES), np.zeros((BODIES - 1, CONTACTS), CONTACT_LANES))


@compiled
def borrowed_lanes(lanes):
    """Return the lanes, borrowed; see `machine.borrowed`."""
    return Lanes(borrowed(lanes.joints), borrowed(lanes.contacts))
