"""The tree in PyTorch is the tree in JAX, and stable-baselines3 treats it as a policy of its own."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete

import sympol
from sympol.functional import entmax15, hard_tree
from sympol.play import fitted_actions

from ..trees.samples import SPECIAL

torch: Any = pytest.importorskip("torch")
sb3: Any = pytest.importorskip("stable_baselines3")
torch.set_num_threads(1)  # its threads wait for each other where cores are shared

from sympol import frameworks  # noqa: E402
from sympol.frameworks import torch_tree  # noqa: E402


def random_parameters(rng: np.random.Generator, depth: int, features: int, outputs: int) -> list[np.ndarray]:
    nodes = 2**depth - 1
    logits = rng.normal(size=(nodes, features)) * rng.choice([0.1, 1, 3])
    logits[rng.random(nodes) < 0.2] = 0.5  # all equal: the lowest index wins
    thresholds = np.where(
        rng.random((nodes, features)) < 0.3, rng.choice(SPECIAL), rng.normal(size=(nodes, features))
    )
    return [np.float32(a) for a in (logits, thresholds, rng.normal(size=(nodes + 1, outputs)))]


def random_x(rng: np.random.Generator, thresholds: np.ndarray, batch: int, *, odd: bool) -> np.ndarray:
    """Observations anywhere and exactly on thresholds; odd ones also infinite, NaN, subnormal, large."""
    features = thresholds.shape[1]
    x = rng.normal(size=(batch, features)).astype(np.float32)
    on = rng.choice(thresholds.ravel(), x.shape)
    x = np.where(rng.random(x.shape) < 0.4, on, x)
    strange = rng.choice(np.float32([*SPECIAL, np.nan, np.inf, -np.inf, 1e12, -1e12]), x.shape)
    return np.where(odd & (rng.random(x.shape) < 0.3), strange, x).astype(np.float32)


def by_torch(parameters: list[np.ndarray], x: np.ndarray, g: np.ndarray, surrogate: Any) -> list[np.ndarray]:
    tensors = [torch.tensor(p, requires_grad=True) for p in parameters]
    out = frameworks.hard_tree(*tensors, torch.tensor(x), surrogate=surrogate)
    out.backward(torch.tensor(g))
    return [out.detach().numpy(), *(t.grad.numpy() for t in tensors)]


def by_jax(parameters: list[np.ndarray], x: np.ndarray, g: np.ndarray, surrogate: Any) -> list[np.ndarray]:
    @jax.jit
    def value_and_gradient(*parameters: jax.Array):
        out, pull = jax.vjp(lambda *p: hard_tree(*p, jnp.asarray(x), surrogate=surrogate), *parameters)
        return out, *pull(jnp.asarray(g))

    return [np.asarray(a) for a in value_and_gradient(*map(jnp.asarray, parameters))]


@pytest.mark.parametrize("surrogate", ["sigmoid", "softsign"])
@pytest.mark.parametrize("odd", [False, True])
def test_value_and_gradient_are_those_in_jax(surrogate, odd):
    rng = np.random.default_rng(0)
    for depth, features, outputs in ((1, 1, 1), (4, 5, 3), (6, 40, 2)):
        parameters = random_parameters(rng, depth, features, outputs)
        x = random_x(rng, parameters[1], 300, odd=odd)
        g = rng.normal(size=(300, outputs)).astype(np.float32)
        ours, theirs = by_torch(parameters, x, g, surrogate), by_jax(parameters, x, g, surrogate)
        np.testing.assert_array_equal(ours[0], theirs[0])
        for mine, its in zip(ours[1:], theirs[1:], strict=True):
            scale = np.abs(its).max() + 1e-30
            np.testing.assert_allclose(mine / scale, its / scale, atol=2e-6)
            assert np.isfinite(mine).all()


def test_the_gradient_of_the_choice_is_entmax15_s():
    rng = np.random.default_rng(1)
    for n in (1, 2, 7, 60):
        logits, v = rng.normal(size=(2, 50, n)).astype(np.float32)
        _, pull = jax.vjp(entmax15, jnp.asarray(logits))
        mine = torch_tree.entmax15_vjp(torch.tensor(logits), torch.tensor(v)).numpy()
        np.testing.assert_allclose(mine, np.asarray(pull(jnp.asarray(v))[0]), atol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda p, x: (p, x[0]), r"x must be float32 of 2 axes, got torch.float32 of shape \(2,\)"),
        (lambda p, x: (p, x.double()), "x must be float32"),
        (lambda p, x: ([*p[:2], p[2][:3]], x), r"leaf_values must have 2\^depth rows.* got 3"),
        (lambda p, x: ([p[0][:2], *p[1:]], x), r"feature_logits must have shape \(3, 2\)"),
        (lambda p, x: (p, x[:, :1]), r"feature_logits must have shape \(3, 1\)"),
    ],
)
def test_shapes_that_do_not_fit_are_refused(change, message):
    rng = np.random.default_rng(2)
    parameters, x = change([torch.tensor(p) for p in random_parameters(rng, 2, 2, 1)], torch.zeros(5, 2))
    with pytest.raises(ValueError, match=message):
        frameworks.hard_tree(*parameters, x)
    with pytest.raises(ValueError, match="surrogate must be one of sigmoid, softsign, got 'relu'"):
        by_torch(
            random_parameters(rng, 2, 2, 1),
            np.zeros((5, 2), np.float32),
            np.zeros((5, 1), np.float32),
            "relu",
        )


# ---- as a policy ----


class World(gymnasium.Env):
    """Shows anything in its space, and takes any action."""

    def __init__(self, observed: gymnasium.Space, taken: gymnasium.Space) -> None:
        self.observation_space, self.action_space = observed, taken

    def reset(self, *, seed: int | None = None, options: Any = None):
        super().reset(seed=seed)
        if seed is not None:
            self.observation_space.seed(seed)
        self.steps = 0
        return self.observation_space.sample(), {}

    def step(self, action: Any):
        assert self.action_space.contains(action), action
        self.steps += 1
        return self.observation_space.sample(), float(np.sum(action)), False, self.steps >= 20, {}


SPACES = {
    "box": (Box(-1, 1, (3,)), Discrete(3)),
    "unbounded": (Box(-np.inf, np.inf, (2, 2)), Box(-1, 1, (2,))),
    "float64": (Box(-2.0, 5.0, (2,), np.float64), Box(-0.1, 0.7, (1,), np.float64)),
    "integers": (Box(0, 255, (6, 6, 1), np.uint8), MultiDiscrete([2, 3])),
    "discrete": (Discrete(4), Discrete(2)),
    "multi_discrete": (MultiDiscrete([2, 3]), Discrete(2)),
    "multi_binary": (MultiBinary(4), Discrete(2)),
    "dict": (Dict({"b": Discrete(3), "a": Box(-1, 1, (2,)), "c": MultiBinary(2)}), MultiDiscrete([2, 2])),
}


def short_ppo(env: Any, seed: int = 0, **policy_kwargs: Any) -> Any:
    policy_kwargs = {"depth": 4, **policy_kwargs}
    return sb3.PPO(
        frameworks.TreePolicy, env, n_steps=64, batch_size=32, n_epochs=2, seed=seed, device="cpu",
        learning_rate=0.01, policy_kwargs=policy_kwargs,
    )  # fmt: skip


@pytest.mark.parametrize("kind", SPACES)
def test_the_tree_answers_as_the_policy_does(kind, tmp_path):
    env = World(*SPACES[kind])
    warm = frameworks.warm_up(env, 100) if kind in ("unbounded", "dict") else {}
    model = short_ppo(env, **warm).learn(128)
    tree = model.policy.to_tree()
    spec = sympol.resolve(env)
    env.observation_space.seed(3)
    seen = [env.observation_space.sample() for _ in range(300)]
    x = spec.features.flatten_each(seen)
    expected = fitted_actions(tree.predict(x), env.action_space)
    acted = np.array([model.predict(observation, deterministic=True)[0] for observation in seen])
    np.testing.assert_array_equal(acted, expected)
    assert tree.groups == spec.features.groups
    assert len(np.unique(tree.apply(x))) > 1
    model.save(tmp_path / "model")
    again = sb3.PPO.load(tmp_path / "model", device="cpu")
    assert again.policy.to_tree() == tree
    model.policy.save(str(tmp_path / "policy"))
    assert frameworks.TreePolicy.load(str(tmp_path / "policy"), device="cpu").to_tree() == tree


def test_the_tree_answers_as_the_policy_does_on_every_threshold():
    rng = np.random.default_rng(4)
    env = World(Box(-np.inf, np.inf, (3,)), Discrete(4))
    for seed in range(6):
        shift, scale = rng.normal(size=3), np.float32(10.0 ** rng.uniform(-6, 6, 3))
        if seed == 5:  # differences that are subnormal, and would count if they were not zero
            shift, scale = np.float32([1.3e-38, -1.3e-38, 2e-38]), np.full(3, np.float32(1e38))
        model = short_ppo(env, seed, depth=6, shift=shift.tolist(), scale=scale.tolist(), threshold_std=1.0)
        with torch.no_grad():
            model.policy.action_net.thresholds[:, 0] = torch.tensor(rng.choice(SPECIAL, 63))
        tree = model.policy.to_tree()
        t = tree.threshold[~tree.is_leaf]
        t = np.concatenate([t, np.nextafter(t, np.float32(np.inf)), np.nextafter(t, np.float32(-np.inf))])
        near = [*(shift * 1.05), *(shift * 0.95), *shift]
        x = rng.choice(np.float32([*t, *SPECIAL, *near, np.inf, -np.inf, np.nan]), (20_000, 3))
        np.testing.assert_array_equal(model.predict(x, deterministic=True)[0], tree.predict(x))


def test_equal_chances_are_not_equal_actions():
    model = short_ppo(World(Box(-1, 1, (1,)), Discrete(2)), depth=1)
    with torch.no_grad():
        model.policy.action_net.leaf_values[:] = torch.tensor([[0.0, 1e-12]])
    assert model.predict(np.zeros(1, np.float32), deterministic=True)[0] == 1
    assert model.policy.to_tree().predict([0.0]) == 1


def test_every_group_of_parameters_has_its_learning_rate():
    world = World(Box(-1, 1, (2,)), Box(-1, 1, (1,)))
    rates = {"feature_logits": 0.5, "thresholds": 0.25, "leaf_values": 0.125, "log_std": 0.0625}
    model = short_ppo(world, learning_rates=rates)
    model.learn(64)
    policy = model.policy
    named = {id(parameter): name for name, parameter in policy.named_parameters()}
    groups = {named[id(p)]: group for group in policy.optimizer.param_groups for p in group["params"]}
    assert set(groups) == set(named.values())
    assert all(group["lr"] == 0.01 for group in groups.values())  # what stable-baselines3 sets, and reads
    before = {name: parameter.detach().clone() for name, parameter in policy.named_parameters()}
    fresh = policy._optimizer(0.01)
    for parameter in policy.parameters():
        parameter.grad = torch.ones_like(parameter)
    fresh.step()
    for name, parameter in policy.named_parameters():
        moved = (before[name] - parameter).detach().abs()
        torch.testing.assert_close(
            moved, torch.full_like(moved, rates.get(name.removeprefix("action_net."), 0.01))
        )


def test_a_tree_reads_in_the_environment_s_words():
    model = short_ppo("CartPole-v1", **frameworks.warm_up("CartPole-v1", 200))
    tree = model.policy.to_tree("CartPole-v1")
    assert tree.feature_names[2] == "pole angle (rad)"
    assert tree.actions.names == ("push left", "push right")
    assert tree.meta == {"env": "CartPole-v1"}
    assert model.policy.to_tree(feature_names=["a", "b", "c", "d"]).feature_names == ("a", "b", "c", "d")
    with pytest.raises(
        ValueError, match=r"observation_space of Acrobot-v1 is .* but the policy was made for"
    ):
        model.policy.to_tree("Acrobot-v1")
    with pytest.raises(ValueError, match=r"give them to sympol\.resolve"):
        model.policy.to_tree(sympol.resolve("CartPole-v1"), action_names=["a", "b"])


def test_a2c_trains_it_too():
    model = sb3.A2C(
        frameworks.TreePolicy, World(*SPACES["box"]), policy_kwargs={"depth": 3}, device="cpu", seed=0
    )
    before = model.policy.action_net.leaf_values.detach().clone()
    model.learn(50)
    assert not torch.equal(before, model.policy.action_net.leaf_values)


@pytest.mark.parametrize(
    ("policy_kwargs", "message"),
    [
        ({"depth": 15}, "depth must be between 1 and 14, got 15"),
        ({"learning_rates": {"leafs": 1}}, "learning_rates are of feature_logits, .*, got .*leafs"),
        ({"shift": [0.0], "scale": [1.0]}, "shift must be 3 finite numbers, one for each feature"),
        ({"scale": [1.0, 0.0, 1.0]}, "scale must be positive"),
        ({"use_sde": True}, "use_sde must be False"),
        ({"surrogate": "relu"}, "surrogate must be one of sigmoid, softsign, got 'relu'"),
    ],
)
def test_bad_arguments_are_refused(policy_kwargs, message):
    space, actions = SPACES["box"]
    with pytest.raises(ValueError, match=message):
        frameworks.TreePolicy(space, actions, lambda _: 0.1, **policy_kwargs)


def test_spaces_that_a_tree_cannot_have_are_refused():
    with pytest.raises(ValueError, match="unsupported action space MultiBinary"):
        frameworks.TreePolicy(SPACES["box"][0], MultiBinary(2), lambda _: 0.1)


@pytest.mark.slow
def test_ppo_learns_where_the_answer_is_known():
    """One step an episode: go where the sign of the second feature says."""

    class Sign(gymnasium.Env):
        observation_space, action_space = Box(-1, 1, (3,)), Discrete(2)

        def reset(self, *, seed: int | None = None, options: Any = None):
            super().reset(seed=seed)
            self.x = self.np_random.uniform(-1, 1, 3).astype(np.float32)
            return self.x, {}

        def step(self, action: Any):
            return self.x, float(action == (self.x[1] > 0.25)), True, False, {}

    model = sb3.PPO(
        frameworks.TreePolicy, Sign(), n_steps=256, batch_size=128, seed=0, device="cpu", learning_rate=0.003,
        policy_kwargs={"depth": 2, "learning_rates": {"thresholds": 0.02, "feature_logits": 0.02}},
    )  # fmt: skip
    model.learn(4_000)
    x = np.random.default_rng(5).uniform(-1, 1, (2000, 3))
    assert (model.policy.to_tree().predict(x) == (x[:, 1] > 0.25)).mean() > 0.93


def test_without_torch_the_error_names_the_extra():
    code = (
        "import sys\nsys.modules['stable_baselines3'] = None\n"
        "try:\n    import sympol.frameworks\nexcept ImportError as error:\n    print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "pip install 'sympol[sb3]'" in done.stdout
