"""A second set of environments that took no part in the development of the defaults, by letters.

Do not read this file, nor `fresh_one` and `fresh_two`, while working on the defaults. They were written after
`held_out` had been looked at by its numbers, each rule with its environment, by someone who has trained no
learner of the study on them. `digest` tells whether they have changed since.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from . import fresh_one as one
from . import fresh_two as two
from .tasks import Task, array

SHORT, STEPS, LONG = 40_000, 100_000, 200_000

TASKS = (
    Task("AA", one.Rover, LONG, one.rover_rule),
    Task("AB", two.Hedge, STEPS, two.hedge_rule, array(0.0)),
    Task("AC", two.Poker, STEPS, two.poker_rule, 1),
    Task("AD", one.Vessel, LONG, one.vessel_rule, array(0.0, 0.0, 0.0)),
    Task("AE", one.Laboratory, STEPS, one.laboratory_rule, 5),
    Task("AF", two.Hotel, SHORT, two.hotel_rule, np.array([1, 1], np.int64)),
    Task("AG", one.Motorway, STEPS, one.motorway_rule, 1),
    Task("AH", one.Panel, SHORT, one.panel_rule),
    Task("AI", two.Epidemic, STEPS, two.epidemic_rule, np.array([0, 0], np.int64)),
    Task("AJ", two.Fishery, STEPS, two.fishery_rule, 0),
)


def digest() -> str:
    """Return the SHA-256 of all files of this set, in the order of their names."""
    folder, whole = Path(__file__).parent, hashlib.sha256()
    for path in sorted(folder.glob("fresh*.py")):
        whole.update(path.read_bytes())
    return whole.hexdigest()
