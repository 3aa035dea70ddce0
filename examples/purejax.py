"""The tree alone, as the network of somebody else's JAX program: a PPO of PureJaxRL's kind, one compiled function.

python examples/purejax.py [steps]
"""

import sys

import jax
import jax.numpy as jnp
import numpy as np
import optax

import sympol
from sympol.envs.classic.cartpole import CartPole
from sympol.functional import hard_tree, select
from sympol.trees import DecisionTree, DiscreteActions

SCALE = jnp.array(
    [[1.0, 1.0, 8.0, 1.0]]
)  # to about unit size; powers of two, so that thresholds scale exactly


def init(
    key, depth, num_features, num_outputs
):  # a network as any other: a dict of arrays, and a function of it
    nodes, keys = 2**depth - 1, jax.random.split(key, 3)
    return {
        "feature_logits": 0.1 * jax.random.normal(keys[0], (nodes, num_features)),
        "thresholds": 0.2 * jax.random.normal(keys[1], (nodes, num_features)),
        "leaf_values": 0.01 * jax.random.normal(keys[2], (nodes + 1, num_outputs)),
    }


def apply(tree, x):
    return hard_tree(tree["feature_logits"], tree["thresholds"], tree["leaf_values"], x * SCALE)


def to_tree(tree):
    feature, threshold = select(tree["feature_logits"], tree["thresholds"])
    parts = (np.asarray(part) for part in (feature, threshold / SCALE[0, feature], tree["leaf_values"]))
    actions = DiscreteActions(2, env.action_names)
    return DecisionTree.from_complete(*parts, actions=actions, feature_names=env.feature_names)


env, num_envs, num_steps, num_epochs, gamma, gae_lambda = CartPole(), 64, 64, 8, 0.99, 0.95
steps = int(sys.argv[1]) if sys.argv[1:] else 500_000
num_iterations = max(1, steps // (num_envs * num_steps))
optimizer = optax.adam(optax.linear_schedule(0.02, 0.0, num_iterations * num_epochs), eps=1e-5)


def act(carry, key):  # one step of all environments; those that end start again
    params, state, x = carry
    keys = jax.random.split(key, 1 + num_envs)
    action = jax.random.categorical(keys[0], apply(params["actor"], x))
    after, step = jax.vmap(env.step)(keys[1:], state, action)
    ended = step.terminated | step.truncated
    fresh = jax.vmap(env.reset)(keys[1:])
    state, following = jax.tree.map(
        lambda new, old: jnp.where(ended.reshape(-1, *[1] * (new.ndim - 1)), new, old),
        fresh,
        (after, step.observation),
    )
    return (params, state, following), (x, action, step, ended)


def advantage(later, now):  # generalised advantage estimation, from the last step to the first
    reward, terminated, ended, value, next_value = now
    delta = reward + gamma * jnp.where(terminated, 0.0, next_value) - value
    later = delta + gamma * gae_lambda * jnp.where(ended, 0.0, later)
    return later, later


def loss(params, x, action, old, advantages, returns):
    log_pi = jax.nn.log_softmax(apply(params["actor"], x))
    ratio = jnp.exp(jnp.take_along_axis(log_pi, action[:, None], 1)[:, 0] - old)
    gain = jnp.minimum(ratio * advantages, jnp.clip(ratio, 0.8, 1.2) * advantages)
    value_loss = jnp.mean((apply(params["critic"], x)[:, 0] - returns) ** 2)
    return value_loss - jnp.mean(gain) + 0.005 * jnp.mean(jnp.sum(jnp.exp(log_pi) * log_pi, 1))


def iteration(carry, key):
    params, opt_state, state, x = carry
    (_, state, x), (seen, action, step, ended) = jax.lax.scan(
        act, (params, state, x), jax.random.split(key, num_steps)
    )
    value, next_value = (
        apply(params["critic"], o.reshape(-1, 4)).reshape(ended.shape) for o in (seen, step.observation)
    )
    reward = (1 - gamma) * step.reward  # values are then at most 1
    parts = reward, step.terminated, ended, value, next_value
    _, advantages = jax.lax.scan(advantage, jnp.zeros(num_envs), parts, reverse=True)
    seen, action, returns = seen.reshape(-1, 4), action.reshape(-1), (advantages + value).reshape(-1)
    advantages = (advantages.reshape(-1) - advantages.mean()) / (advantages.std() + 1e-8)
    old = jnp.take_along_axis(jax.nn.log_softmax(apply(params["actor"], seen)), action[:, None], 1)[:, 0]

    def epoch(carry, _):
        params, opt_state = carry
        updates, opt_state = optimizer.update(
            jax.grad(loss)(params, seen, action, old, advantages, returns), opt_state
        )
        return (optax.apply_updates(params, updates), opt_state), None

    (params, opt_state), _ = jax.lax.scan(epoch, (params, opt_state), None, length=num_epochs)
    return (params, opt_state, state, x), None


@jax.jit
def train(keys, first):
    params = {"actor": init(first[0], 5, 4, 2), "critic": init(first[1], 6, 4, 1)}
    state, x = jax.vmap(env.reset)(jax.random.split(first[2], num_envs))
    (params, *_), _ = jax.lax.scan(iteration, (params, optimizer.init(params), state, x), keys)
    return params


seed = int(sys.argv[2]) if sys.argv[2:] else 0
keys = jax.random.split(jax.random.key(seed), 3 + num_iterations)
params = train(keys[3:], keys[:3])
tree = to_tree(params["actor"]).prune()
print(tree)
mean, std = sympol.evaluate_policy(tree, "CartPole-v1", 100)
print(f"\n{tree.n_nodes} nodes, return {mean:.1f} ± {std:.1f} over 100 episodes")
