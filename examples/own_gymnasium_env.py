"""A Gymnasium environment of one's own: heat a room, but not too much. The names end up in the tree.

python examples/own_gymnasium_env.py [steps]
"""

import sys

import gymnasium
import numpy as np

import sympol


class Thermostat(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(np.float32([-20, 0]), np.float32([40, 30]))
    action_space = gymnasium.spaces.Discrete(2)
    feature_names = ("outside (°C)", "inside (°C)")
    action_names = ("off", "heat")

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.outside, self.inside, self.time = self.np_random.uniform(-10, 20), 15.0, 0
        return np.float32([self.outside, self.inside]), {}

    def step(self, action):
        self.time += 1
        self.inside = float(np.clip(self.inside + 0.1 * (self.outside - self.inside) + 3 * action, 0, 30))
        reward = 1 - abs(self.inside - 20) / 10 - 0.1 * action
        return np.float32([self.outside, self.inside]), reward, False, self.time == 50, {}


steps = int(sys.argv[1]) if sys.argv[1:] else 100_000
agent = sympol.PPO("tree", Thermostat, seed=0, depth=3).learn(steps)
print(agent.tree())
print(sympol.evaluate_policy(agent, Thermostat, n_eval_episodes=20))
