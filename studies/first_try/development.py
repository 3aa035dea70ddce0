"""The environments on which the defaults were developed: those of the table that began it.

Steps are those of that table. None of them may serve to judge the defaults; `held_out` has the ones that do.
"""

from __future__ import annotations

import math
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiDiscrete

from .tasks import Episodic, Task, array, box, number, one_hot


class Thermostat(Episodic):
    """A heated room for a day of quarter hours: three levels of heating, a price of heat that changes with the hour."""

    length = 96
    observation_space = box((-20, -30, 0, 0), (50, 50, 24, 5))
    action_space = Discrete(3)

    def begin(self) -> None:
        """Draw the weather, the prices and the temperature indoors."""
        self.mean, self.level, self.indoor = (
            self.np_random.uniform(low, high) for low, high in ((-8, 12), (0.6, 1.6), (15, 23))
        )

    def outdoor(self, hour: float) -> float:
        """Return the temperature outdoors."""
        return self.mean + 5 * math.sin((hour - 9) / 24 * 2 * math.pi)

    def price(self, hour: float) -> float:
        """Return the price of a unit of heat."""
        peak = 7 <= hour < 10 or 17 <= hour < 21
        return self.level * (0.15 if hour < 6 else 0.5 if peak else 0.25)

    def observe(self) -> np.ndarray:
        """Return the temperatures indoors and outdoors, the hour and the price."""
        hour = self.t / 4
        return array(self.indoor, self.outdoor(hour), hour % 24, self.price(hour))

    def advance(self, action: Any) -> tuple[float, bool]:
        """Heat; discomfort counts fully while someone is at home."""
        hour, power = self.t / 4, float(action)
        self.indoor += (
            0.03 * (self.outdoor(hour) - self.indoor) + 0.75 * power + self.np_random.normal(0, 0.05)
        )
        target = 20.5 if 6 <= hour < 22 else 18.0
        away = 8 <= hour < 16
        discomfort = 0.3 * max(0.0, 16 - self.indoor) if away else max(0.0, abs(self.indoor - target) - 0.7)
        return -discomfort - self.price(hour) * power, False


def thermostat_rule(observation: np.ndarray) -> int:
    """Five rules: keep warm at night and in the absence, else heat up to 20.3 degrees."""
    indoor, _, hour, _ = observation
    if hour >= 22 or hour < 5:
        return int(indoor < 17.7)
    if 8 <= hour < 14.5:
        return int(indoor < 16.2)
    return 2 if indoor < 19 else int(indoor < 20.3)


class Inventory(Episodic):
    """Order goods for fifty days; unmet demand is lost, stock costs money."""

    length = 50
    observation_space = box((0, 0, 0, 0), (1000, 100, 100, 100))
    action_space = box(0, 100, 1)

    def demand(self) -> float:
        """Draw the demand of a day, around a level that drifts."""
        self.level = min(max(self.level + self.np_random.normal(0, 4), 10), 60)
        return min(max(self.np_random.normal(self.level, 6), 0), 100)

    def begin(self) -> None:
        """Draw the stock and the demands of three days."""
        self.level, self.stock = self.np_random.uniform(15, 50), self.np_random.uniform(0, 60)
        self.last = [self.demand() for _ in range(3)]

    def observe(self) -> np.ndarray:
        """Return the stock and the last three demands."""
        return array(self.stock, *self.last)

    def advance(self, action: Any) -> tuple[float, bool]:
        """Order, sell, pay."""
        order = number(action, 0, 100)
        self.stock = min(1000.0, self.stock + order)
        demand = self.demand()
        sold = min(demand, self.stock)
        self.stock -= sold
        self.last = [demand, *self.last[:2]]
        return 5 * sold - 2 * order - 0.5 * self.stock - 3 * (demand - sold), False


def inventory_rule(observation: np.ndarray) -> np.ndarray:
    """Order up to the mean of the last demands and a little more."""
    return array(min(max(float(np.mean(observation[1:])) + 8 - float(observation[0]), 0), 100))


class Reservoir(Episodic):
    """Keep the level of a reservoir at 50 by the release of water, of which the inflow needs a part only."""

    length = 50
    observation_space = box((0, 0), (100, 50))
    action_space = box(0, 50, 1)

    def begin(self) -> None:
        """Draw the level and the inflow."""
        self.level, self.inflow = self.np_random.uniform(20, 80), self.np_random.uniform(5, 15)

    def observe(self) -> np.ndarray:
        """Return the level and the inflow."""
        return array(self.level, self.inflow)

    def advance(self, action: Any) -> tuple[float, bool]:
        """Release water; the distance from 50 costs."""
        self.level = min(max(self.level + self.inflow - number(action, 0, 50), 0), 100)
        self.inflow = min(max(self.inflow + self.np_random.normal(0, 2), 0), 30)
        return -abs(self.level - 50) / 10, False


def reservoir_rule(observation: np.ndarray) -> np.ndarray:
    """Release what flows in and what is too much."""
    level, inflow = map(float, observation)
    return array(min(max(inflow + level - 50, 0), 50))


class Switches(Episodic):
    """Two switches at once, one by a level and one by a mode; the best return is 40."""

    length = 20
    observation_space = Dict({"level": Box(-1, 1, (2,), np.float32), "mode": Discrete(3)})
    action_space = MultiDiscrete([2, 3])

    def begin(self) -> None:
        """Draw a level and a mode."""
        self.level, self.mode = (
            self.np_random.uniform(-1, 1, 2).astype(np.float32),
            int(self.np_random.integers(3)),
        )

    def observe(self) -> dict[str, Any]:
        """Return both."""
        return {"level": self.level.copy(), "mode": self.mode}

    def advance(self, action: Any) -> tuple[float, bool]:
        """Count the switches that are right."""
        reward = float(action[0] == (self.level[0] > 0.2)) + float(action[1] == self.mode)
        self.begin()
        return reward, False


def switches_rule(observation: dict[str, Any]) -> np.ndarray:
    """Do what is right."""
    return np.array([observation["level"][0] > 0.2, observation["mode"]], np.int64)


class Needle(Episodic):
    """Two hundred features, of which three matter; the best return is 20, a random one 5."""

    length = 20
    observation_space = box(-10, 10, 200)
    action_space = Discrete(4)

    def begin(self) -> None:
        """Draw the features."""
        self.x = self.np_random.standard_normal(200, np.float32).clip(-10, 10)

    def observe(self) -> np.ndarray:
        """Return all features."""
        return self.x.copy()

    def advance(self, action: Any) -> tuple[float, bool]:
        """Compare with the right action."""
        reward = float(int(action) == needle_rule(self.x))
        self.begin()
        return reward, False


def needle_rule(observation: np.ndarray) -> int:
    """Look at the three features."""
    action = 2 * int(observation[17] > 0) + int(observation[101] > 0.3)
    return 3 - action if observation[55] > 1 else action


class Scales(Episodic):
    """Three features, unbounded, of sizes 1e6, 1 and 1e-6; the best return is 50, a random one 12.5."""

    length = 50
    sizes = (1e6, 1.0, 1e-6)
    observation_space = box(-np.inf, np.inf, 3)
    action_space = Discrete(4)

    def begin(self) -> None:
        """Draw the features."""
        self.x = self.np_random.uniform(-1, 1, 3)

    def observe(self) -> np.ndarray:
        """Return them in their sizes."""
        return (self.x * self.sizes).astype(np.float32)

    def advance(self, action: Any) -> tuple[float, bool]:
        """Compare with the right action."""
        reward = float(int(action) == 2 * int(self.x[0] > 0.1) + int(self.x[2] > -0.2))
        self.begin()
        return reward, False


def scales_rule(observation: np.ndarray) -> int:
    """Look at the first feature and the last one."""
    return 2 * int(observation[0] > 1e5) + int(observation[2] > -2e-7)


class Unbounded(Episodic):
    """Hold an unstable number at zero; beside it stand its sum and a log-normal distractor, all without bounds."""

    length = 100
    observation_space = box(-np.inf, np.inf, 3)
    action_space = Discrete(3)

    def begin(self) -> None:
        """Draw the number."""
        self.x, self.sum = self.np_random.normal(0, 3), 0.0

    def observe(self) -> np.ndarray:
        """Return the number, its sum and the distractor."""
        return array(self.x, self.sum, math.exp(self.np_random.normal(0, 2.5)))

    def advance(self, action: Any) -> tuple[float, bool]:
        """Push the number up or down."""
        self.x = 1.02 * self.x + 0.4 * (int(action) - 1) + self.np_random.normal(0, 0.1)
        self.sum += self.x
        return -min(abs(self.x), 10) / 10, False


def unbounded_rule(observation: np.ndarray) -> int:
    """Push towards zero."""
    return 1 - int(observation[0] > 0.2) + int(observation[0] < -0.2)


class LateReward(Episodic):
    """Name the sign of a number four hundred times; only the last hundred count, so that chance has 50 of 100."""

    length = 400
    observation_space = box((-1, 0), (1, 1))
    action_space = Discrete(2)

    def begin(self) -> None:
        """Draw the number."""
        self.x = self.np_random.uniform(-1, 1)

    def observe(self) -> np.ndarray:
        """Return the number and the time."""
        return array(self.x, self.t / self.length)

    def advance(self, action: Any) -> tuple[float, bool]:
        """Compare, late."""
        reward = float(self.t >= 300 and int(action) == int(self.x > 0))
        self.begin()
        return reward, False


def late_rule(observation: np.ndarray) -> int:
    """Name the sign."""
    return int(observation[0] > 0)


class SlippingFloor(Episodic):
    """Cross a floor of 5 x 5 cells, in one-hot form, to the goal; a tenth of all steps slip; four cells are holes."""

    length = 40
    observation_space = box(0, 1, 25)
    action_space = Discrete(4)
    holes = (6, 8, 16, 18)

    def begin(self) -> None:
        """Stand in the first corner."""
        self.cell = 0

    def observe(self) -> np.ndarray:
        """Return the cell."""
        return one_hot((self.cell, 25))

    def advance(self, action: Any) -> tuple[float, bool]:
        """Move up, right, down or left; a slip is a move in any direction."""
        direction = int(self.np_random.integers(4)) if self.np_random.random() < 0.1 else int(action)
        row, column = divmod(self.cell, 5)
        row += (-1, 0, 1, 0)[direction]
        column += (0, 1, 0, -1)[direction]
        self.cell = 5 * min(max(row, 0), 4) + min(max(column, 0), 4)
        return float(self.cell == 24), self.cell == 24 or self.cell in self.holes


def floor_rule(observation: np.ndarray) -> int:
    """Go along the upper wall or the lower one, then along the right one."""
    row, column = divmod(int(np.argmax(observation)), 5)
    if column == 4:
        return 2
    return 1 if row in (0, 4) else 0 if row < 3 else 2


LAKE = (0, 3, 3, 3, 0, 0, 0, 0, 3, 1, 0, 0, 0, 2, 1, 0)
"""The best move in each cell of the slippery lake of 4 x 4."""


def lake_rule(observation: Any) -> int:
    """Take the move that slips into no hole."""
    return LAKE[int(observation)]


class ScaledReward(gymnasium.RewardWrapper[Any, Any]):
    """Multiply rewards by a constant."""

    def __init__(self, env: gymnasium.Env[Any, Any], scale: float) -> None:
        super().__init__(env)
        self.scale = scale

    def reward(self, reward: Any) -> float:
        """Return the reward, scaled."""
        return float(reward) * self.scale


def scaled_cart_pole(scale: float) -> gymnasium.Env[Any, Any]:
    """Return CartPole with rewards of another size."""
    return ScaledReward(gymnasium.make("CartPole-v1"), scale)


def cart_pole_rule(observation: np.ndarray) -> int:
    """Push to where the pole falls, and a little towards the middle."""
    x, v, angle, spin = map(float, observation)
    return int(0.05 * x + 0.1 * v + angle + 0.5 * spin > 0)


def large_cart_pole() -> gymnasium.Env[Any, Any]:
    """Return CartPole with rewards of 10,000."""
    return scaled_cart_pole(1e4)


def small_cart_pole() -> gymnasium.Env[Any, Any]:
    """Return CartPole with rewards of 0.0001."""
    return scaled_cart_pole(1e-4)


def host_cart_pole() -> gymnasium.Env[Any, Any]:
    """Return CartPole as an environment that sympol does not know."""
    return scaled_cart_pole(1.0)


TASKS = (
    Task("thermostat", Thermostat, 200_000, thermostat_rule, 0),
    Task("inventory", Inventory, 200_000, inventory_rule, array(0.0)),
    Task("reservoir", Reservoir, 200_000, reservoir_rule, array(0.0)),
    Task("switches", Switches, 60_000, switches_rule),
    Task("needle", Needle, 200_000, needle_rule),
    Task("scales", Scales, 100_000, scales_rule),
    Task("unbounded", Unbounded, 100_000, unbounded_rule, 1),
    Task("late", LateReward, 51_200, late_rule),
    Task("lake", "FrozenLake-v1", 300_000, lake_rule),
    Task("floor", SlippingFloor, 200_000, floor_rule),
    Task("taxi", "Taxi-v4", 300_000),
    Task("cartpole", host_cart_pole, 50_000, cart_pole_rule),
    Task("cartpole-1e4", large_cart_pole, 50_000, cart_pole_rule),
    Task("cartpole-1e-4", small_cart_pole, 50_000, cart_pole_rule),
    Task("inverted-pendulum", "InvertedPendulum-v5", 100_000, needs="mujoco"),
    Task("hopper", "Hopper-v5", 100_000, needs="mujoco"),
    Task("unlock", "MiniGrid-Unlock-v0", 300_000, needs="minigrid"),
    Task("simple-crossing", "MiniGrid-SimpleCrossingS9N2-v0", 300_000, needs="minigrid"),
    Task("lava-crossing", "MiniGrid-LavaCrossingS9N1-v0", 300_000, needs="minigrid"),
    Task("dynamic-obstacles", "MiniGrid-Dynamic-Obstacles-8x8-v0", 300_000, needs="minigrid"),
)
