"""Held-out environments with queues, markets and games. Whoever works on the defaults must not read this file."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from gymnasium.spaces import Discrete, MultiDiscrete

from .tasks import Episodic, array, box, one_hot


class Routing(Episodic):
    """Route jobs to three servers of different speed, and hire more hands when it is worth its price."""

    length = 300
    observation_space = box((0,) * 5, (60, 60, 60, 2, 3))
    action_space = MultiDiscrete([3, 2])
    speeds = (0.55, 0.35, 0.2)

    def begin(self) -> None:
        """Start with short queues."""
        self.queues = [float(n) for n in self.np_random.integers(0, 6, 3)]
        self.load, self.size = self.np_random.uniform(0.5, 1.1), 1.0

    def observe(self) -> np.ndarray:
        """Return the queues, the load and the size of the job at the door."""
        return array(*self.queues, self.load, self.size)

    def advance(self, action: Any) -> tuple[float, bool]:
        """Send the job, serve, pay for the waiting and for the hands."""
        where, hands = int(action[0]), int(action[1])
        self.queues[where] = min(self.queues[where] + self.size, 60)
        for i, speed in enumerate(self.speeds):
            work = speed * (1.5 if hands else 1.0) * self.np_random.uniform(0.5, 1.5)
            self.queues[i] = max(0.0, self.queues[i] - work)
        self.load = min(max(self.load + self.np_random.normal(0, 0.05), 0.3), 1.5)
        self.size = min(self.load * self.np_random.exponential(), 3.0)
        return -0.05 * sum(self.queues) - 0.25 * hands, False


def routing_rule(x: np.ndarray) -> np.ndarray:
    """Go where the wait is shortest; hire hands for long queues."""
    waits = [(float(x[i]) + float(x[4])) / speed for i, speed in enumerate(Routing.speeds)]
    return np.array([int(np.argmin(waits)), int(x[0] + x[1] + x[2] > 8)], np.int64)


class Crossing(Episodic):
    """A traffic light: keep the phase or switch, which takes time; cars arrive unevenly on four lanes."""

    length = 200
    observation_space = box((0,) * 6, (100, 100, 100, 100, 1, 50))
    action_space = Discrete(2)

    def begin(self) -> None:
        """Draw queues and the rates of arrival."""
        self.cars = [int(n) for n in self.np_random.integers(0, 8, 4)]
        self.rates = [float(rate) for rate in self.np_random.uniform(0.1, 0.55, 4)]
        self.phase, self.since = int(self.np_random.integers(2)), 5

    def observe(self) -> np.ndarray:
        """Return the queues, the phase and the time since the switch."""
        return array(*self.cars, self.phase, min(self.since, 50))

    def advance(self, action: Any) -> tuple[float, bool]:
        """Switch or not; let cars pass after two steps of yellow; each car that waits costs."""
        if int(action):
            self.phase, self.since = 1 - self.phase, 0
        self.since += 1
        arrivals = self.np_random.random(4)
        for lane in range(4):
            if arrivals[lane] < self.rates[lane]:
                self.cars[lane] = min(self.cars[lane] + 1, 100)
            if lane // 2 == self.phase and self.since > 2 and self.cars[lane]:
                self.cars[lane] -= 1
        return -0.1 * sum(self.cars), False


def crossing_rule(x: np.ndarray) -> int:
    """Switch when the others are more by five, or nobody is left here, but not before five steps."""
    ours, theirs = float(x[0] + x[1]), float(x[2] + x[3])
    if x[4] > 0.5:
        ours, theirs = theirs, ours
    return int(x[5] >= 5 and (theirs > ours + 5 or (ours == 0 and theirs > 0)))


class Spread(Episodic):
    """Trade a price difference that returns to its mean: short, flat or long, with costs; most indicators are noise."""

    length = 250
    observation_space = box(-np.inf, np.inf, 25)
    action_space = Discrete(3)

    def begin(self) -> None:
        """Draw the difference."""
        self.value, self.slow, self.held = self.np_random.normal(0, 1.2), 0.0, 0
        self.noise = self.np_random.standard_normal(22)

    def observe(self) -> np.ndarray:
        """Return the difference, its slow average, the position, and 22 indicators that mean nothing."""
        x = np.empty(25, np.float32)
        x[0], x[1], x[2] = self.value, self.slow, self.held
        x[3:] = self.noise
        return x

    def advance(self, action: Any) -> tuple[float, bool]:
        """Take the position, pay for the change, earn by the move."""
        position = int(action) - 1
        cost = 0.002 * abs(position - self.held)
        self.held, before = position, self.value
        self.value += -0.06 * self.value + self.np_random.normal(0, 0.4)
        self.slow += 0.05 * (self.value - self.slow)
        self.noise = 0.9 * self.noise + self.np_random.standard_normal(22)
        return 0.01 * position * (self.value - before) - cost, False


def spread_rule(x: np.ndarray) -> int:
    """Sell high, buy low, and otherwise hold until the mean is reached."""
    value, held = float(x[0]), float(x[2])
    if value > 1:
        return 0
    if value < -1:
        return 2
    return 1 if held * value > 0 else 1 + round(held)


class Delivery(Episodic):
    """A shuttle on a ring of twelve stops: fetch parcels at one of two stops, bring each to the stop that it names."""

    length = 100
    observation_space = box(0, 1, 18)
    action_space = Discrete(3)
    goals = (1, 4, 8, 10)

    def begin(self) -> None:
        """Stand anywhere, empty."""
        self.stop, self.goal = int(self.np_random.integers(12)), 4
        self.source = int(self.np_random.integers(2))

    def observe(self) -> np.ndarray:
        """Return the stop, the parcel's goal or none, and an alarm bell of no meaning, in one-hot form."""
        x = one_hot((self.stop, 12), (self.goal, 5), (0, 1))
        x[17] = float(self.np_random.random() < 0.5)
        return x

    def advance(self, action: Any) -> tuple[float, bool]:
        """Go left, go right, or load and unload."""
        reward = 0.0
        if int(action) < 2:
            self.stop = (self.stop + (-1, 1)[int(action)]) % 12
        elif self.goal == 4 and self.stop in (0, 6):
            self.goal, reward = int(self.np_random.integers(4)), 0.1
        elif self.goal < 4 and self.stop == self.goals[self.goal]:
            self.goal, reward = 4, 1.0
        return reward, False


def delivery_rule(x: np.ndarray) -> int:
    """Take the shorter way to the next stop of interest, and load or unload there."""
    stop, goal = int(np.argmax(x[:12])), int(np.argmax(x[12:17]))
    targets = (0, 6) if goal == 4 else (Delivery.goals[goal],)
    ways = [(target - stop + 6) % 12 - 6 for target in targets]
    way = min(ways, key=abs)
    return 2 if way == 0 else int(way > 0)


class Pursuit(Episodic):
    """Catch one that drifts about a square; there is no reward but for the catch."""

    length = 80
    observation_space = box(-2, 2, 6)
    action_space = Discrete(5)
    moves = ((0.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0))

    def begin(self) -> None:
        """Draw both places."""
        self.x, self.y, self.u, self.v = (float(z) for z in self.np_random.uniform(-1, 1, 4))
        self.turn = self.np_random.uniform(0, 2 * math.pi)

    def observe(self) -> np.ndarray:
        """Return the own place, the other's, and its direction."""
        return array(self.x, self.y, self.u, self.v, math.cos(self.turn), math.sin(self.turn))

    def advance(self, action: Any) -> tuple[float, bool]:
        """Move both."""
        dx, dy = self.moves[int(action)]
        self.x, self.y = (min(max(z + 0.1 * d, -1), 1) for z, d in ((self.x, dx), (self.y, dy)))
        self.turn = (self.turn + self.np_random.normal(0, 0.4)) % (2 * math.pi)
        self.u = min(max(self.u + 0.04 * math.cos(self.turn), -1), 1)
        self.v = min(max(self.v + 0.04 * math.sin(self.turn), -1), 1)
        caught = math.hypot(self.x - self.u, self.y - self.v) < 0.12
        return (1 - self.t / self.length if caught else 0.0), caught


def pursuit_rule(x: np.ndarray) -> int:
    """Shorten the greater distance."""
    dx, dy = float(x[2] - x[0]), float(x[3] - x[1])
    if abs(dx) > abs(dy):
        return 3 if dx > 0 else 4
    return 1 if dy > 0 else 2


class Lift(Episodic):
    """A lift of five floors: up, down or open; people call, enter and want to go elsewhere."""

    length = 150
    observation_space = box(0, 1, 15)
    action_space = Discrete(3)

    def begin(self) -> None:
        """Start somewhere, with a call."""
        self.floor = int(self.np_random.integers(5))
        self.calls, self.wants = [0] * 5, [0] * 5
        self.calls[int(self.np_random.integers(5))] = 1

    def observe(self) -> np.ndarray:
        """Return the floor in one-hot form, the floors that called, and those that riders want."""
        x = one_hot((self.floor, 5), (0, 10))
        x[5:] = [float(n > 0) for n in (*self.calls, *self.wants)]
        return x

    def advance(self, action: Any) -> tuple[float, bool]:
        """Move or open; who waits or rides costs, who arrives counts."""
        reward = 0.0
        if int(action) == 2:
            reward = float(self.wants[self.floor])
            self.wants[self.floor] = 0
            for _ in range(self.calls[self.floor]):
                other = [floor for floor in range(5) if floor != self.floor]
                down = self.floor and self.np_random.random() < 0.5
                self.wants[0 if down else other[int(self.np_random.integers(4))]] += 1
            self.calls[self.floor] = 0
        else:
            self.floor = min(max(self.floor + (1, -1)[int(action)], 0), 4)
        if self.np_random.random() < 0.15 and sum(self.calls) + sum(self.wants) < 12:
            self.calls[0 if self.np_random.random() < 0.4 else int(self.np_random.integers(5))] += 1
        return reward - 0.02 * (sum(self.calls) + sum(self.wants)), False


def lift_rule(x: np.ndarray) -> int:
    """Open where somebody wants in or out; else go to the nearest such floor, riders first."""
    floor = int(np.argmax(x[:5]))
    if x[5 + floor] or x[10 + floor]:
        return 2
    wanted = [i for i in range(5) if x[10 + i]] or [i for i in range(5) if x[5 + i]] or [0]
    nearest = min(wanted, key=lambda i: abs(i - floor))
    return int(nearest < floor)


class Pig(Episodic):
    """The dice game: roll on or hold; a one loses the turn; a hundred wins, against a player who holds at twenty."""

    length = 400
    observation_space = box(0, 120, 3)
    action_space = Discrete(2)

    def begin(self) -> None:
        """Start at zero; the other one may have a turn already."""
        self.ours, self.theirs, self.turn = 0, 0, 0
        if self.np_random.random() < 0.5:
            self.theirs += self.other_turn()

    def other_turn(self) -> int:
        """Return what the other player makes of a turn."""
        total = 0
        while total < 20 and self.theirs + total < 100:
            die = int(self.np_random.integers(1, 7))
            if die == 1:
                return 0
            total += die
        return total

    def observe(self) -> np.ndarray:
        """Return both scores and the total of the turn."""
        return array(self.ours, self.theirs, self.turn)

    def advance(self, action: Any) -> tuple[float, bool]:
        """Roll or hold; the lead at the end of the game is all that counts."""
        if int(action) == 0:
            die = int(self.np_random.integers(1, 7))
            if die > 1:
                self.turn += die
                return 0.0, False
            self.turn = 0
        self.ours, self.turn = self.ours + self.turn, 0
        if self.ours < 100:
            self.theirs += self.other_turn()
        over = self.ours >= 100 or self.theirs >= 100
        return (self.ours - self.theirs) / 100 * over, over


def pig_rule(x: np.ndarray) -> int:
    """Hold at twenty, or when it wins."""
    ours, _, turn = map(float, x)
    return int(turn >= 20 or ours + turn >= 100)
