"""An environment of one's own in JAX, trained inside the compiled program: walk to the flag and stop there.

python examples/own_jax_env.py [steps]
"""

import sys

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np

import sympol
from sympol.types import Step


class Corridor:
    observation_space = gymnasium.spaces.Box(-1, 1, (2,), np.float32)
    action_space = gymnasium.spaces.Discrete(3)
    feature_names, action_names = ("me", "flag"), ("left", "stay", "right")
    max_episode_steps = 30

    def reset(self, key):
        places = jax.random.uniform(key, (2,), minval=-1, maxval=1)
        return (places, jnp.int32(0)), places

    def step(self, key, state, action):
        places, time = state
        me = jnp.clip(places[0] + 0.1 * (action - 1).astype(jnp.float32), -1, 1)
        places, time = places.at[0].set(me), time + 1
        reward = -jnp.abs(me - places[1])
        return (places, time), Step(places, reward, jnp.bool_(False), time >= self.max_episode_steps)


steps = int(sys.argv[1]) if sys.argv[1:] else 300_000
agent = sympol.PPO("tree", Corridor(), seed=0, depth=4).learn(steps)
print(agent.tree())
