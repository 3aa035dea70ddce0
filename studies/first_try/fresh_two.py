"""More environments of the second held-out set. Whoever works on the defaults must not read this file."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiDiscrete

from .tasks import Episodic, array, box, number, one_hot


class Hedge(Episodic):
    """Hold shares against a call option on forty lots that was sold for thirty days; each trade costs."""

    length = 30
    observation_space = box((-100, 0, 0, 0), (400, 30, 100, 40))
    action_space = box(0, 40, 1)

    def begin(self) -> None:
        """Draw how the price stands to the strike, and how much it varies in a year."""
        self.price, self.sigma = self.np_random.uniform(0.9, 1.1), self.np_random.uniform(0.15, 0.6)
        self.held = 0.0

    def value(self, days: float) -> float:
        """Return the value of an option with a strike of one, by the formula of Black and Scholes."""
        if days <= 0:
            return max(self.price - 1, 0.0)
        spread = self.sigma * math.sqrt(days / 250)
        first = math.log(self.price) / spread + spread / 2
        one, two = (0.5 * (1 + math.erf(d / math.sqrt(2))) for d in (first, first - spread))
        return self.price * one - two

    def observe(self) -> np.ndarray:
        """Return price over strike in per cent, the days left, the yearly variation, the lots held."""
        ahead = min(max(100 * (self.price - 1), -100.0), 400.0)
        return array(ahead, self.length - self.t, 100 * self.sigma, self.held)

    def advance(self, action: Any) -> tuple[float, bool]:
        """Choose what to hold until tomorrow; the gain or loss of the day counts as a risk in either case."""
        left = float(self.length - self.t)
        held, price, value = number(action, 0, 40), self.price, self.value(left)
        daily = self.sigma / math.sqrt(250)
        self.price *= math.exp(daily * self.np_random.standard_normal() - daily**2 / 2)
        gain = held * (self.price - price) - 40 * (self.value(left - 1) - value)
        cost = 0.001 * price * abs(held - self.held)
        self.held = held
        return -450 * (abs(gain) + cost), False


def hedge_rule(x: np.ndarray) -> np.ndarray:
    """Hold the share of lots that will be called, by a logistic curve; leave small differences alone."""
    ahead, left, sigma, held = map(float, x)
    wanted = 40 / (1 + math.exp(min(max(-1.7 * ahead / (sigma * math.sqrt(max(left, 1) / 250)), -50), 50)))
    return array(held if abs(wanted - held) < 2 else wanted)


class Poker(Episodic):
    """Poker with six cards of three ranks, two rounds and one open card, against one who bluffs at times.

    A hand follows upon the other; the chips of a hand are paid at its end.
    """

    length = 100
    observation_space = box(0, 1, 14)
    action_space = Discrete(3)

    def begin(self) -> None:
        """Deal."""
        self.own, self.other, self.board = (int(card) // 2 for card in self.np_random.permutation(6)[:3])
        self.paid, self.second, self.pressed = [1, 1], False, False
        self.facing, self.raises = False, 0

    def observe(self) -> np.ndarray:
        """Return all in one-hot form.

        It is the own card, the open one or none, if there is a bet to answer, the raises of this round, and
        whether the other player has bet in this hand.
        """
        board = 1 + self.board if self.second else 0
        pressed, facing = int(self.pressed), int(self.facing)
        return one_hot((self.own, 3), (board, 4), (facing, 2), (self.raises, 3), (pressed, 2))

    def advance(self, action: Any) -> tuple[float, bool]:
        """Fold, check or call, or bet and raise, and hear the answer of the other player."""
        choice, size = int(action), 4 if self.second else 2
        if choice == 0:
            return self.end(-self.paid[0])
        mood = self.strength() + self.np_random.uniform(-0.35, 0.35)
        if choice == 2 and self.raises < 2:
            self.paid[0] = self.paid[1] + size
            self.raises += 1
            if mood < 0.4:
                return self.end(self.paid[1])
            if mood < 0.85 or self.raises == 2:
                self.paid[1] = self.paid[0]
                return self.go_on()
        elif self.facing:
            self.paid[0] = self.paid[1]
            return self.go_on()
        elif mood < 0.6 and self.np_random.random() > 0.1:
            return self.go_on()
        self.paid[1] = self.paid[0] + size
        self.raises += 1
        self.facing = self.pressed = True
        return 0.0, False

    def strength(self) -> float:
        """Return what the other player thinks of the own hand."""
        if not self.second:
            return (0.25, 0.5, 0.8)[self.other]
        return 1.0 if self.other == self.board else (0.2, 0.4, 0.65)[self.other]

    def go_on(self) -> tuple[float, bool]:
        """Show the open card, or both hands."""
        if not self.second:
            self.second, self.facing, self.raises = True, False, 0
            return 0.0, False
        own, other = (card + 9 * (card == self.board) for card in (self.own, self.other))
        return self.end(0 if own == other else self.paid[1] if own > other else -self.paid[0])

    def end(self, chips: int) -> tuple[float, bool]:
        """Pay, and deal anew."""
        self.begin()
        return float(chips), False


def poker_rule(x: np.ndarray) -> int:
    """Raise a pair, and a king before the open card; call with what may become the best, fold the rest."""
    own, board, facing = int(np.argmax(x[:3])), int(np.argmax(x[3:7])) - 1, x[8] > 0
    if own == board or (board < 0 and own == 2):
        return 2
    return 0 if facing and board >= 0 and own < 2 else 1


class Hotel(Episodic):
    """Set the prices of forty rooms and ten suites for one night, on each of the sixty days before it."""

    length = 60
    observation_space = box((0, 0, 1, 40), (40, 10, 60, 180))
    action_space = MultiDiscrete([4, 4])
    rooms, suites = (79.0, 109.0, 149.0, 219.0), (159.0, 219.0, 299.0, 449.0)

    def begin(self) -> None:
        """Draw the demand for the night."""
        self.left, self.index = [40, 10], self.np_random.uniform(0.5, 1.7)

    def observe(self) -> np.ndarray:
        """Return the rooms, suites and days that are left, and the demand in per cent of last year's."""
        index = min(max(100 * self.index + self.np_random.normal(0, 5), 40.0), 180.0)
        return array(*self.left, max(self.length - self.t, 1), index)

    def advance(self, action: Any) -> tuple[float, bool]:
        """Take bookings in euros; those who book late pay more."""
        room, suite = self.rooms[int(action[0])], self.suites[int(action[1])]
        late = self.t / self.length
        rate, purse = self.index * (0.9 + 1.2 * late**2), 60 + 150 * late**2
        wanted = 0.8 * rate * math.exp(-((room / purse) ** 2) / 2)
        better = 0.21 * rate * math.exp(-((suite / (2.1 * purse)) ** 2) / 2)
        if suite < 1.3 * room:
            wanted, better = 0.6 * wanted, better + 0.4 * wanted
        sold = [
            min(int(self.np_random.poisson(n)), k) for n, k in zip((wanted, better), self.left, strict=True)
        ]
        self.left = [k - n for k, n in zip(self.left, sold, strict=True)]
        return room * sold[0] + suite * sold[1], False


def hotel_rule(x: np.ndarray) -> np.ndarray:
    """Ask for more as the night comes closer, and one step more where rooms do not last for the demand."""
    room, suite, days, index = map(float, x)
    base = 0 if days > 32 else 1 if days > 20 else 2 if days > 6 else 3
    prices = [
        min(base + (left < total * days * index / 4500), 3) for left, total in ((room, 40), (suite, 10))
    ]
    return np.array(prices, np.int64)


class Epidemic(Episodic):
    """Choose contact measures and test campaigns each week against a disease that returns; beds are few."""

    length = 100
    observation_space = Dict(
        {
            "counts": Box(np.zeros(3, np.float32), np.array([1e5, 2000, 100], np.float32)),
            "season": Discrete(4),
            "weary": Box(0, 100, (1,), np.float32),
        }
    )
    action_space = MultiDiscrete([3, 2])
    seasons = (1.3, 1.0, 0.75, 1.1)

    def begin(self) -> None:
        """Draw the disease and its spread."""
        self.week, self.factor = int(self.np_random.integers(52)), self.np_random.uniform(1.5, 2.1)
        self.ill, self.immune = self.np_random.uniform(0.0005, 0.004), self.np_random.uniform(0.1, 0.4)
        self.beds, self.weary = 0.5, 0.0

    def observe(self) -> dict[str, Any]:
        """Return cases of 100,000, beds in use and immunity in per cent, season, weeks of measures."""
        cases = min(1e5 * self.ill * self.np_random.uniform(0.8, 1.2), 1e5)
        counts = array(cases, min(100 * self.beds, 2000.0), 100 * self.immune)
        return {"counts": counts, "season": self.week // 13 % 4, "weary": array(min(self.weary, 100.0))}

    def advance(self, action: Any) -> tuple[float, bool]:
        """Let the disease spread; measures, cases and a lack of beds cost millions."""
        level, tests = int(action[0]), int(action[1])
        tired = math.exp(-0.03 * self.weary)
        effect = (1 - (0.0, 0.25, 0.5)[level] * tired) * (1 - 0.12 * tests)
        spread = (
            self.factor * self.seasons[self.week // 13 % 4] * effect * math.exp(self.np_random.normal(0, 0.1))
        )
        self.ill = min(spread * self.ill * (1 - self.immune) + 2e-5, 0.5 * (1 - self.immune))
        self.immune = min(max(0.988 * self.immune + self.ill, 0.0), 1.0)
        self.beds += 0.5 * (self.ill / 0.012 - self.beds)
        self.weary = self.weary + 1 if level else max(0.0, self.weary - 2)
        self.week = (self.week + 1) % 52
        measures = (0.0, 4.0, 12.0)[level] + 1.5 * tests
        return -measures - 600 * self.ill - 60 * max(0.0, self.beds - 1), False


def epidemic_rule(x: dict[str, Any]) -> np.ndarray:
    """Act by the cases, sooner in winter and autumn; close only when beds will lack."""
    cases, beds, immune = map(float, x["counts"])
    cold, open_share = x["season"] in (0, 3), 1 - immune / 100
    growing = cases * open_share * (1.3 if cold else 1.0)
    level = 2 if growing > 900 or beds > 110 else int(growing > 350)
    return np.array([level, int(growing > 250)], np.int64)


class Fishery(Episodic):
    """Send a boat out or not for 240 weeks; the fish stock was fished down and grows if it is spared."""

    length = 240
    observation_space = box((0, 0, 0, 0, 80), (3000, 20, 15, 52, 300))
    action_space = Discrete(3)

    def begin(self) -> None:
        """Draw the stock, the season and the prices."""
        self.stock, self.week = self.np_random.uniform(120, 260), int(self.np_random.integers(52))
        self.price, self.diesel, self.waves = (
            self.np_random.uniform(3, 5),
            self.np_random.uniform(120, 200),
            1.5,
        )

    def observe(self) -> np.ndarray:
        """Return sonar in tonnes, euros a kilogram, waves in metres, the week, diesel in cents a litre."""
        sonar = min(self.stock * math.exp(self.np_random.normal(0, 0.12)), 3000.0)
        return array(sonar, self.price, self.waves, self.week, self.diesel)

    def advance(self, action: Any) -> tuple[float, bool]:
        """Stay in the harbour, or go out with the net or with the trawl; count thousands of euros."""
        gear = int(action)
        storm = self.waves > 3.5
        share = (0.0, 0.10, 0.25)[gear] * (0.4 if storm else 1.0)
        catch = share * max(0.0, self.stock - 60)
        cost = 1.0 + (0.0, 0.09, 0.2)[gear] * self.diesel * (1.6 if storm else 1.0)
        reward = catch * self.price - cost
        growth = 0.08 * (1.6 if 10 <= self.week < 24 else 0.8)
        one, two, three = self.np_random.normal(0, 1, 3).tolist()
        left = self.stock - catch
        self.stock = min(max(left + growth * left * (1 - left / 1000) + 0.02 * left * one, 30.0), 1500.0)
        self.week = (self.week + 1) % 52
        self.price = min(max(self.price + 0.1 * (4 - self.price) + 0.25 * two, 1.5), 8.0)
        self.diesel = min(max(self.diesel + 4 * three, 90.0), 280.0)
        rough = 1.8 if self.week < 12 or self.week > 40 else 1.2
        self.waves = min(rough * self.np_random.gamma(2.5, 0.5), 15.0)
        return reward, False


def fishery_rule(x: np.ndarray) -> int:
    """Spare the stock until it is large; then go out in good weather, with the trawl if it is very large."""
    sonar, price, waves, _, _ = map(float, x)
    if sonar < 450 or waves > 3.5:
        return 0
    return 2 if sonar > 560 and price > 3.5 else 1
