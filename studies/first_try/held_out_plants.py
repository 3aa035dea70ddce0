"""Held-out environments with processes to control. Whoever works on the defaults must not read this file."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from gymnasium.spaces import Discrete

from .tasks import Episodic, array, box, number


class Tanks(Episodic):
    """Two tanks in a row with a pump each; hold both levels at targets that change once."""

    length = 200
    observation_space = box(0, 10, 4)
    action_space = box(0, 5, 2)

    def begin(self) -> None:
        """Draw levels and targets."""
        self.levels = [self.np_random.uniform(0.5, 6) for _ in range(2)]
        self.targets = [self.np_random.uniform(1, 4), self.np_random.uniform(2, 6)]
        self.change = int(self.np_random.integers(60, 140))

    def observe(self) -> np.ndarray:
        """Return the levels and the targets."""
        return array(*self.levels, *self.targets)

    def advance(self, action: Any) -> tuple[float, bool]:
        """Pump, flow, and pay for the distances and a little for the pumps."""
        one, two = (min(max(float(u), 0), 5) for u in action)
        first, second = self.levels
        flow = math.sqrt(first)
        first += 0.15 * (one - flow) + self.np_random.normal(0, 0.02)
        second += 0.15 * (0.5 * two + flow - 1.3 * math.sqrt(second)) + self.np_random.normal(0, 0.02)
        self.levels = [min(max(first, 0), 10), min(max(second, 0), 10)]
        if self.t == self.change:
            self.targets = [self.np_random.uniform(1, 4), self.np_random.uniform(2, 6)]
        distance = sum(abs(level - target) for level, target in zip(self.levels, self.targets, strict=True))
        return -distance - 0.01 * (one + two), False


def tanks_rule(x: np.ndarray) -> np.ndarray:
    """Pump what flows out, and more or less by the distance."""
    first, second, target, goal = map(float, x)
    one = math.sqrt(first) + 4 * (target - first)
    two = 2 * (1.3 * math.sqrt(second) - math.sqrt(first)) + 8 * (goal - second)
    return np.clip(array(one, two), 0, 5)


class Reactor(Episodic):
    """A reaction that heats itself; the temperature of the jacket is to be chosen; too hot ends the batch."""

    length = 150
    observation_space = box((-30, 0, -10), (150, 1, 60))
    action_space = box(-3, 40, 1)

    def begin(self) -> None:
        """Draw the start of a batch."""
        self.hot, self.rest, self.jacket = self.np_random.uniform(15, 30), 1.0, 20.0
        self.heat = self.np_random.uniform(900, 1100)

    def observe(self) -> np.ndarray:
        """Return the temperature, the educt that is left, and the jacket's temperature."""
        return array(self.hot, self.rest, self.jacket)

    def advance(self, action: Any) -> tuple[float, bool]:
        """React; the product is worth 100 a batch, time is worth a little."""
        self.jacket += 0.3 * (number(action, -3, 40) - self.jacket)
        rate = min(0.0012 * math.exp((self.hot - 30) / 10), 0.5) * self.rest
        self.rest -= rate
        self.hot += 0.12 * (self.jacket - self.hot) + self.heat * rate * 0.35 + self.np_random.normal(0, 0.2)
        if self.hot > 90:
            return -100.0, True
        return 100 * rate - 0.2 * max(0.0, self.hot - 70) - 0.05, False


def reactor_rule(x: np.ndarray) -> np.ndarray:
    """Warm up to about 50 degrees, and cool in proportion beyond."""
    return np.clip(array(20 + 3 * (48 - float(x[0]))), -3, 40)


class Battery(Episodic):
    """A household's battery for a week of hours: hold, charge or discharge at prices that are known for the day."""

    length = 168
    observation_space = box((0, 0, -1, -1, -1, -1, 0), (1, 24, 2, 2, 2, 2, 2))
    action_space = Discrete(3)

    def begin(self) -> None:
        """Draw the charge and the week's prices."""
        self.charge = self.np_random.uniform(0, 1)
        hours = np.arange(self.length + 1)
        days = self.np_random.normal(0, 0.05, 9)[hours // 24] + 0.22
        peaks = 0.10 * np.exp(-(((hours % 24) - 8) ** 2) / 6) + 0.16 * np.exp(-(((hours % 24) - 19) ** 2) / 6)
        noon = self.np_random.uniform(0.0, 0.2, 9)[hours // 24] * np.exp(-(((hours % 24) - 13) ** 2) / 8)
        self.prices = days + peaks - noon + self.np_random.normal(0, 0.015, hours.size)
        self.suns = np.clip(5 * noon * np.sin(np.clip((hours % 24) - 6, 0, 12) / 12 * np.pi), 0, 1)

    def observe(self) -> np.ndarray:
        """Return charge, hour, price, the day's mean, least and greatest price, and the sun."""
        day = self.prices[self.t // 24 * 24 : self.t // 24 * 24 + 24]
        price, sun = self.prices[self.t], self.suns[self.t]
        return array(self.charge, self.t % 24, price, day.sum() / len(day), day.min(), day.max(), sun)

    def advance(self, action: Any) -> tuple[float, bool]:
        """Buy and sell at the price; a tenth is lost in charging, wear costs a little."""
        price, before = float(self.prices[self.t]), self.charge
        change = (0.0, 0.25, -0.25)[int(action)]
        self.charge = min(max(self.charge + change, 0.0), 1.0)
        moved = self.charge - before
        cost = moved / 0.9 * price if moved > 0 else moved * price
        free = min(max(moved, 0) / 0.9, 0.25 * float(self.suns[self.t])) * price
        return -cost + free - 0.01 * abs(moved), False


def battery_rule(x: np.ndarray) -> int:
    """Charge well below the day's mean price, discharge well above it."""
    _, _, price, mean, least, greatest, _ = map(float, x)
    if price < mean - 0.5 * (mean - least):
        return 1
    return 2 if price > mean + 0.5 * (greatest - mean) else 0


class Machine(Episodic):
    """A machine that wears: run it, service it, or replace it; a failure is expensive."""

    length = 100
    observation_space = box((0, 0, 0, 0), (50, 10, 200, 1))
    action_space = Discrete(3)

    def begin(self) -> None:
        """Draw an age."""
        self.wear, self.age, self.job = self.np_random.uniform(0, 1), 0, self.np_random.random()
        self.shake = 0.0

    def observe(self) -> np.ndarray:
        """Return the vibration, the temperature, the age and the size of the next job."""
        return array(self.shake, min(2 + 0.8 * self.wear, 10), self.age, self.job)

    def advance(self, action: Any) -> tuple[float, bool]:
        """Earn by the job, or pay for care."""
        if int(action) == 0:
            reward = 1000 * (0.5 + self.job)
            self.wear += self.np_random.exponential(0.35) * (0.5 + self.job)
            self.age += 1
            if self.np_random.random() < 0.002 * math.exp(min(self.wear, 6)):
                reward, self.wear, self.age = -8000.0, 0.0, 0
        elif int(action) == 1:
            reward, self.wear = -600.0, max(0.0, 0.4 * self.wear + 0.01 * self.age)
        else:
            reward, self.wear, self.age = -3000.0, 0.0, 0
        self.job = self.np_random.random()
        self.shake = min(abs(self.wear + self.np_random.normal(0, 0.25)), 50)
        return reward, False


def machine_rule(x: np.ndarray) -> int:
    """Service when it shakes, earlier before a large job; replace what is old and shakes again."""
    shake, _, age, job = map(float, x)
    if age > 60 and shake > 2:
        return 2
    return int(shake > 3.2 - job)


class Boiler(Episodic):
    """A boiler of which a hundred sensors are read; five levels of firing follow the demand for steam."""

    length = 150
    observation_space = box(-20, 20, 100)
    action_space = Discrete(5)

    def begin(self) -> None:
        """Draw the state; most sensors read something else that drifts."""
        self.pressure, self.heat = self.np_random.uniform(-1.5, 1.5), 2.0
        self.demand = self.np_random.uniform(1, 3)
        self.drift = self.np_random.standard_normal(100)

    def observe(self) -> np.ndarray:
        """Return the sensors: pressure is number 23, heat 41, demand 77, a noisy copy of the pressure 60."""
        x = self.drift.astype(np.float32)
        x[23], x[41], x[77] = self.pressure, self.heat - 2, self.demand - 2
        x[60] = self.pressure + self.np_random.normal(0, 0.5)
        return np.clip(x, -20, 20)

    def advance(self, action: Any) -> tuple[float, bool]:
        """Fire; the pressure answers late."""
        self.heat += 0.5 * (int(action) - self.heat)
        self.pressure += 0.25 * (self.heat - self.demand) + self.np_random.normal(0, 0.05)
        self.pressure = min(max(self.pressure, -10), 10)
        self.demand = min(max(self.demand + self.np_random.normal(0, 0.12), 0.5), 3.5)
        self.drift += 0.3 * (self.np_random.standard_normal(100) - self.drift)
        return 1 - min(abs(self.pressure), 4), False


def boiler_rule(x: np.ndarray) -> int:
    """Fire by the demand, more where pressure lacks and heat has not yet come."""
    pressure, heat, demand = (float(x[i]) for i in (23, 41, 77))
    return min(max(round(2 + demand - 2.0 * pressure - 0.5 * (heat - demand)), 0), 4)


class Irrigation(Episodic):
    """Water a field for 250 days, four times a day; a crop that thirsts or drowns grows less."""

    length = 1000
    observation_space = box((0, -10, 0, 0, 0, 0), (120, 45, 50, 1, 250, 24))
    action_space = box(0, 12, 1)

    def begin(self) -> None:
        """Draw the moisture and the weather."""
        self.moisture, self.mean = self.np_random.uniform(30, 70), self.np_random.uniform(14, 22)
        self.weather(0)

    def weather(self, quarter: int) -> None:
        """Draw the weather of a quarter of a day, and whether rain is likely."""
        season = 8 * math.sin(quarter / 1000 * math.pi)
        self.warm = self.mean - 6 + season + (-4, 3, 6, 0)[quarter % 4] + self.np_random.normal(0, 2)
        self.likely = self.np_random.beta(0.5, 3)
        self.rain = self.np_random.exponential(8) if self.np_random.random() < 0.4 * self.likely else 0.0

    def observe(self) -> np.ndarray:
        """Return moisture, temperature, the last rain, the chance of rain, the day and the hour."""
        warm = min(max(self.warm, -10), 45)
        return array(self.moisture, warm, min(self.rain, 50), self.likely, self.t / 4, self.t % 4 * 6)

    def advance(self, action: Any) -> tuple[float, bool]:
        """Water, evaporate, grow."""
        water = number(action, 0, 12)
        dry = 0.12 * max(self.warm, 0) * (0.4 + 0.6 * self.moisture / 100)
        self.moisture = min(max(self.moisture + water + self.rain - dry, 0), 120)
        stress = max(0.0, 45 - self.moisture) / 45 + max(0.0, self.moisture - 75) / 45
        self.weather(self.t + 1)
        return 0.1 - 0.5 * stress - 0.02 * water, False


def irrigation_rule(x: np.ndarray) -> np.ndarray:
    """Fill up to 50, to less where rain is likely."""
    return np.clip(array((46 if x[3] > 0.5 else 50) - float(x[0])), 0, 12)


class Dosing(Episodic):
    """Twenty-four doses of a drug against a growth; too much at once is poison and ends the treatment."""

    length = 24
    observation_space = box((0, 0, 0, 0), (20, 20, 10, 24))
    action_space = box(0, 5, 1)

    def begin(self) -> None:
        """Draw a patient: growth and sensitivity differ."""
        self.growth, self.kill = self.np_random.uniform(0.05, 0.15), self.np_random.uniform(0.08, 0.14)
        self.tumour, self.blood, self.harm = self.np_random.uniform(2, 6), 0.0, 0.0

    def observe(self) -> np.ndarray:
        """Return the size of the growth, the drug in the blood, the harm so far and the time."""
        return array(min(self.tumour, 20), min(self.blood, 20), min(self.harm, 10), self.t)

    def advance(self, action: Any) -> tuple[float, bool]:
        """Dose; the growth and the harm cost."""
        self.blood = 0.6 * self.blood + number(action, 0, 5)
        self.tumour *= math.exp(
            self.growth - self.kill * min(self.blood, 6) / 2 + self.np_random.normal(0, 0.03)
        )
        self.harm = max(0.0, self.harm + 0.25 * max(0.0, self.blood - 3) - 0.15)
        if self.harm > 5 or self.tumour > 20:
            return -20.0, True
        return -0.2 * self.tumour - 0.3 * self.harm - 0.02 * self.blood, False


def dosing_rule(x: np.ndarray) -> np.ndarray:
    """Hold the blood near 4, lower when harm has come or little is left to treat."""
    tumour, blood, harm, _ = map(float, x)
    level = 2.5 if harm > 1.5 or tumour < 0.3 else 4.0
    return np.clip(array(level - 0.6 * blood), 0, 5)
