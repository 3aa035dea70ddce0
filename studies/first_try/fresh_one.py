"""Environments of the second held-out set. Whoever works on the defaults must not read this file."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from gymnasium.spaces import Discrete

from .tasks import Episodic, array, box, one_hot


class Rover(Episodic):
    """Collect one sample after another in a field, and be back at the dock before the battery is empty.

    The only rewards are one for each sample and a loss for a rover that has to be carried home.
    """

    length = 300
    observation_space = box((-600,) * 4 + (0,), (600,) * 4 + (2600,))
    action_space = Discrete(8)
    side, reach, full = 600.0, 30.0, 2600.0
    moves = tuple((20 * math.cos(i * math.pi / 4), 20 * math.sin(i * math.pi / 4)) for i in range(8))

    def begin(self) -> None:
        """Draw the dock and the first sample; the rover starts at the dock with a full battery."""
        self.dock = self.place()
        self.here, self.sample, self.charge = self.dock, self.place(), self.full

    def place(self) -> tuple[float, float]:
        """Draw a place in the field."""
        return self.np_random.uniform(0, self.side), self.np_random.uniform(0, self.side)

    def observe(self) -> np.ndarray:
        """Return the ways to the sample and the dock in centimetres, and the charge in mAh."""
        (x, y), (u, v), (p, q) = self.here, self.sample, self.dock
        return array(u - x, v - y, p - x, q - y, self.charge)

    def advance(self, action: Any) -> tuple[float, bool]:
        """Drive in one of the eight directions of the compass, counted from the east against the clock."""
        (x, y), (dx, dy) = self.here, self.moves[int(action)]
        slip = self.np_random.uniform(0.6, 1.1)
        x, y = min(max(x + slip * dx, 0.0), self.side), min(max(y + slip * dy, 0.0), self.side)
        self.here, reward = (x, y), 0.0
        self.charge = max(0.0, self.charge - self.np_random.uniform(15, 25))
        if math.hypot(self.sample[0] - x, self.sample[1] - y) < self.reach:
            self.sample, reward = self.place(), 1.0
        if math.hypot(self.dock[0] - x, self.dock[1] - y) < self.reach:
            self.charge = self.full
        return (reward - 3.0, True) if self.charge <= 0 else (reward, False)


def rover_rule(x: np.ndarray) -> int:
    """Go to the dock when the charge is low, else to the sample; take diagonals while both ways are long."""
    east, north, home_east, home_north, charge = map(float, x)
    if charge < 800:
        east, north = home_east, home_north
    right, up = (0 if abs(way) < 15 else 1 if way > 0 else -1 for way in (east, north))
    if right > 0:
        return (7, 0, 1)[up + 1]
    if right < 0:
        return (5, 4, 3)[up + 1]
    return 6 if up < 0 else 2


class Vessel(Episodic):
    """Hold a ship over a well with thrusters ahead, abeam and about, in gusty wind, and do not drift off."""

    length = 300
    observation_space = box(
        (-60, -60, -180, -400, -400, -400, 0, -180), (60, 60, 180, 400, 400, 400, 80, 180)
    )
    action_space = box((-500, -300, -9000), (500, 300, 9000))
    seconds = 5.0

    def begin(self) -> None:
        """Draw the place, the heading and the wind."""
        self.north, self.east = self.np_random.uniform(-12, 12), self.np_random.uniform(-12, 12)
        self.heading = self.np_random.uniform(-15, 15)
        self.surge = self.sway = self.spin = 0.0
        self.wind, self.blow = self.np_random.uniform(4, 13), self.np_random.uniform(-180, 180)

    def relative(self) -> float:
        """Return where the wind blows to, in degrees from the bow."""
        return (self.blow - self.heading + 180) % 360 - 180

    def observe(self) -> np.ndarray:
        """Return what the bridge shows.

        These are the metres by which the well lies ahead and to starboard and the heading, then the same as
        they will be in forty seconds with the speeds of now, the wind in knots and where it blows to.
        """
        turn = math.radians(self.heading)
        ahead = -self.north * math.cos(turn) - self.east * math.sin(turn)
        abeam = self.north * math.sin(turn) - self.east * math.cos(turn)
        soon = ahead - 40 * self.surge, abeam - 40 * self.sway, self.heading + 40 * self.spin
        ahead, abeam = min(max(ahead, -60.0), 60.0), min(max(abeam, -60.0), 60.0)
        soon = [min(max(value, -400.0), 400.0) for value in soon]
        return array(ahead, abeam, self.heading, *soon, 1.944 * self.wind, self.relative())

    def advance(self, action: Any) -> tuple[float, bool]:
        """Thrust in kilonewtons and kilonewton-metres; the distance, the heading and the fuel cost."""
        push, side, moment = (
            min(max(float(u), -high), high) for u, high in zip(action, (500.0, 300.0, 9000.0), strict=True)
        )
        towards, force = math.radians(self.relative()), self.wind**2
        along = push + 0.5 * force * math.cos(towards)
        across = side + 0.7 * force * math.sin(towards)
        about = moment + 6.0 * force * math.sin(2 * towards)
        self.surge += self.seconds * (along / 6000 - 0.01 * self.surge)
        self.sway += self.seconds * (across / 9000 - 0.02 * self.sway)
        self.spin += self.seconds * (math.degrees(about / 8e6) - 0.03 * self.spin)
        self.heading = (self.heading + self.seconds * self.spin + 180) % 360 - 180
        turn = math.radians(self.heading)
        self.north += self.seconds * (self.surge * math.cos(turn) - self.sway * math.sin(turn))
        self.east += self.seconds * (self.surge * math.sin(turn) + self.sway * math.cos(turn))
        gust, veer = self.np_random.normal(0, 1, 2).tolist()
        self.wind = min(max(self.wind + 0.3 * gust, 2.0), 15.0)
        self.blow += 2 * veer
        distance = math.hypot(self.north, self.east)
        if distance > 40:
            return -20.0, True
        fuel = abs(push) / 500 + abs(side) / 300 + abs(moment) / 9000
        return 1 - distance / 20 - abs(self.heading) / 60 - 0.05 * fuel, False


def vessel_rule(x: np.ndarray) -> np.ndarray:
    """Push against the wind, and against what the distance and the heading will be soon."""
    *_, ahead, abeam, heading, wind, towards = map(float, x)
    force, towards = (wind / 1.944) ** 2, math.radians(towards)
    push = 14 * ahead - 0.5 * force * math.cos(towards)
    side = 20 * abeam - 0.7 * force * math.sin(towards)
    return np.clip(array(push, side, -350 * heading), array(-500, -300, -9000), array(500, 300, 9000))


class Laboratory(Episodic):
    """Take samples of four kinds through the steps that each kind needs; only a right measurement counts.

    A wrong step spoils the sample, which nothing but throwing it away can mend. The centrifuge is at times in
    use by others, and then spinning spoils as well.
    """

    length = 120
    observation_space = box(0, 1, 10)
    action_space = Discrete(6)
    protocols = (("spin", "dilute"), ("dilute",), ("heat", "spin"), ("heat",))
    deeds = ("heat", "spin", "dilute")

    def begin(self) -> None:
        """Start with a new sample."""
        self.fetch()
        self.used = False

    def fetch(self) -> None:
        """Draw a new sample."""
        self.kind, self.done, self.spoilt = int(self.np_random.integers(4)), 0, False

    def observe(self) -> np.ndarray:
        """Return kind and last step in one-hot form, if it is spoilt, and if the centrifuge is in use."""
        protocol = self.protocols[self.kind]
        last = 1 + self.deeds.index(protocol[self.done - 1]) if self.done else 0
        x = one_hot((self.kind, 4), (last, 4), (0, 2))
        x[8], x[9] = self.spoilt, self.used
        return x

    def advance(self, action: Any) -> tuple[float, bool]:
        """Heat, spin, dilute, measure, throw away or wait."""
        deed, reward, protocol = int(action), 0.0, self.protocols[self.kind]
        if deed == 4:
            self.fetch()
        elif deed == 3:
            if self.done == len(protocol) and not self.spoilt:
                reward = 1.0
                self.fetch()
            else:
                self.spoilt = True
        elif deed < 3:
            right = self.done < len(protocol) and protocol[self.done] == self.deeds[deed]
            if not right or (deed == 1 and self.used) or self.np_random.random() < 0.05:
                self.spoilt = True
            elif not self.spoilt:
                self.done += 1
        self.used = bool(self.np_random.random() < 0.3)
        return reward, False


def laboratory_rule(x: np.ndarray) -> int:
    """Follow the protocol, and wait for the centrifuge."""
    kind, last = int(np.argmax(x[:4])), int(np.argmax(x[4:8]))
    if x[8]:
        return 4
    protocol = [Laboratory.deeds.index(deed) for deed in Laboratory.protocols[kind]]
    done = protocol.index(last - 1) + 1 if last else 0
    if done == len(protocol):
        return 3
    return 5 if protocol[done] == 1 and x[9] else protocol[done]


class Motorway(Episodic):
    """Drive on three lanes past slower cars, with a view of twelve rows; a crash ends the ride."""

    length = 400
    observation_space = box(0, 1, 39)
    action_space = Discrete(3)
    rows = 12

    def begin(self) -> None:
        """Start in any lane with a free view, and let the first cars come into it."""
        self.lane, self.since = int(self.np_random.integers(3)), 0
        self.cars = np.zeros((self.rows, 3), np.float32)
        for _ in range(self.rows - 3):
            self.roll()

    def roll(self) -> None:
        """Come one row closer; at least two free rows lie between rows with one or two cars."""
        self.cars[:-1] = self.cars[1:]
        self.cars[-1] = 0
        self.since += 1
        if self.since > 2 and self.np_random.random() < 0.4:
            free, more = int(self.np_random.integers(3)), self.np_random.random() < 0.6
            self.cars[-1] = 1
            self.cars[-1, free] = 0
            if not more:
                self.cars[-1, (free + 1) % 3] = 0
            self.since = 0

    def observe(self) -> np.ndarray:
        """Return the own lane in one-hot form, and the cells ahead, row by row from the nearest."""
        x = np.zeros(39, np.float32)
        x[self.lane] = 1
        x[3:] = self.cars.ravel()
        return x

    def advance(self, action: Any) -> tuple[float, bool]:
        """Go to the left, stay or go to the right; each row is 25 metres, a change of the lane costs one."""
        self.lane = min(max(self.lane + int(action) - 1, 0), 2)
        crash = bool(self.cars[0, self.lane])
        self.roll()
        return (-200.0 if crash else 25.0) - abs(int(action) - 1), crash


def motorway_rule(x: np.ndarray) -> int:
    """Look for a close car in the own lane; go towards the nearest lane that is free in its row."""
    lane, cars = int(np.argmax(x[:3])), x[3:].reshape(12, 3)
    for row in range(4):
        if cars[row, lane]:
            free = [other for other in range(3) if not cars[row, other]]
            step = 1 if min(free, key=lambda other: abs(other - lane)) > lane else -1
            return 1 if cars[0, lane + step] and not cars[0, lane] else 1 + step
    return 1


class Panel(Episodic):
    """Find the voltage at which a solar panel gives most under passing clouds, by the last changes alone."""

    length = 600
    observation_space = box((-5, -400), (5, 400))
    action_space = Discrete(2)

    def begin(self) -> None:
        """Draw the voltage, the sun and the panel."""
        self.voltage, self.sun = self.np_random.uniform(6, 37), self.np_random.uniform(0.4, 1.0)
        self.open = self.np_random.uniform(34, 39)
        self.power, self.change, self.gain = self.output(), 0.0, 0.0

    def output(self) -> float:
        """Return the power in watts."""
        current = 8.5 * self.sun * (1 - math.exp(min((self.voltage - self.open) / 3.0, 1.0)))
        return max(0.0, self.voltage * current)

    def observe(self) -> np.ndarray:
        """Return the last changes of the voltage and of the power."""
        return array(self.change, self.gain)

    def advance(self, action: Any) -> tuple[float, bool]:
        """Go down or up with the voltage for ten seconds; count watt-hours."""
        before = self.voltage
        self.voltage = min(max(before + (0.7 if int(action) else -0.7), 5.0), 40.0)
        noise, cloud = self.np_random.normal(0, 1, 2).tolist()
        self.sun = min(max(self.sun + 0.004 * cloud, 0.2), 1.0)
        power = self.output()
        self.change, self.gain = (
            self.voltage - before,
            min(max(power - self.power + 0.3 * noise, -400.0), 400.0),
        )
        self.power = power
        return power / 360, False


def panel_rule(x: np.ndarray) -> int:
    """Go on where the power has grown, turn back where it has fallen."""
    change, gain = map(float, x)
    return int(gain > 0) if change > 0 else int(gain < 0)
