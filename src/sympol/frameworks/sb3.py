"""A decision tree as a policy of stable-baselines3: ``PPO(TreePolicy, "CartPole-v1", policy_kwargs={"depth": 5})``.

stable-baselines3 trains, saves, loads and evaluates it as it does any other policy. What acts is the tree; beside it is
an MLP as the critic. Both see features scaled by an affine map that is fixed before training.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, get_args

import gymnasium
import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.distributions import (  # pyright: ignore[reportMissingImports]
    CategoricalDistribution,
    DiagGaussianDistribution,
)
from stable_baselines3.common.policies import ActorCriticPolicy  # pyright: ignore[reportMissingImports]
from stable_baselines3.common.torch_layers import MlpExtractor  # pyright: ignore[reportMissingImports]
from torch import Tensor, nn  # pyright: ignore[reportMissingImports]

from ..envs.registry import resolve
from ..envs.spaces import Features, action_spec
from ..envs.spec import EnvSpec
from ..policies.extract import raw_tree
from ..trees import DecisionTree
from ..trees.actions import ActionSpec, BoxActions
from ..trees.groups import Group
from .scaling import ScaledFeatures, scaling
from .torch_tree import MAX_DEPTH, Surrogate, hard_tree, select

LEARNING_RATES = {"feature_logits": 0.01, "thresholds": 0.002, "leaf_values": 0.01, "log_std": 0.001}
"""Of the tree's parameters, those of sympol's own training; the critic's is the algorithm's ``learning_rate``."""


class TreeActor(nn.Module):
    """The parameters of a complete tree; forward, the values of the leaf of each row."""

    def __init__(
        self, depth: int, num_features: int, num_outputs: int, threshold_std: float, surrogate: Surrogate
    ) -> None:
        super().__init__()
        nodes = 2**depth - 1
        self.feature_logits = nn.Parameter(0.1 * torch.randn(nodes, num_features))
        self.thresholds = nn.Parameter(threshold_std * torch.randn(nodes, num_features))
        self.leaf_values = nn.Parameter(0.01 * torch.randn(nodes + 1, num_outputs))
        self.surrogate: Surrogate = surrogate

    def forward(self, x: Tensor) -> Tensor:
        """Logits or means [batch, outputs] of scaled features, differentiable straight through."""
        return hard_tree(self.feature_logits, self.thresholds, self.leaf_values, x, surrogate=self.surrogate)


class TreePolicy(ActorCriticPolicy):
    """An actor-critic policy of stable-baselines3 whose actor is a hard decision tree, for PPO and A2C.

    Args:
        observation_space: As stable-baselines3 gives it: all that `sympol` can describe, but Tuple.
        action_space: Discrete (from 0), MultiDiscrete or Box.
        lr_schedule: The algorithm's; it is the critic's learning rate, and the others follow its course.
        depth: Depth of the tree, 1 to 14.
        surrogate: What the hard step becomes going backward.
        threshold_std: Initial standard deviation of the thresholds, in scaled units.
        learning_rates: Others than `LEARNING_RATES`, by name.
        shift: Shift of the scaling (x − shift) · scale, one number per feature; `warm_up` finds both. By default
            features with finite bounds go to [−1, 1], and the others keep their size.
        scale: Scale of the same scaling, one positive number per feature.
        net_arch: Width of each hidden layer of the critic.
        activation_fn: Between them.
        log_std_init: Initial log standard deviation of continuous actions.
        optimizer_class: What steps.
        optimizer_kwargs: What it is told besides its parameters and learning rates.
        use_sde: Must be False: a tree has no state-dependent noise.

    Raises:
        ValueError: an argument out of bounds, or a space that a tree cannot have.
    """

    action_net: TreeActor
    features_extractor: ScaledFeatures

    def __init__(
        self,
        observation_space: gymnasium.Space,
        action_space: gymnasium.Space,
        lr_schedule: Any,
        *,
        depth: int = 5,
        surrogate: Surrogate = "sigmoid",
        threshold_std: float = 0.3,
        learning_rates: Mapping[str, float] | None = None,
        shift: Sequence[float] | None = None,
        scale: Sequence[float] | None = None,
        net_arch: Sequence[int] = (64, 64),
        activation_fn: type[nn.Module] = nn.Tanh,
        log_std_init: float = 0.0,
        optimizer_class: type[torch.optim.Optimizer] = torch.optim.Adam,
        optimizer_kwargs: dict[str, Any] | None = None,
        use_sde: bool = False,
    ) -> None:
        features = Features.of(observation_space)
        action_spec(action_space)
        if not 1 <= depth <= MAX_DEPTH:
            raise ValueError(f"depth must be between 1 and {MAX_DEPTH}, got {depth}")
        if surrogate not in get_args(Surrogate):
            raise ValueError(f"surrogate must be one of {', '.join(get_args(Surrogate))}, got {surrogate!r}")
        if use_sde:
            raise ValueError("use_sde must be False: a tree has no state-dependent noise")
        unknown = set(learning_rates or {}) - set(LEARNING_RATES)
        if unknown:
            raise ValueError(f"learning_rates are of {', '.join(LEARNING_RATES)}, got {sorted(unknown)}")
        by_bounds = scaling(features, np.zeros((1, len(features.names))))
        self.depth, self.threshold_std = depth, threshold_std
        self.surrogate: Surrogate = surrogate
        self.critic_sizes = list(net_arch)
        self.learning_rates = {**LEARNING_RATES, **(learning_rates or {})}
        self.scaling = {
            "shift": by_bounds["shift"] if shift is None else list(shift),
            "scale": by_bounds["scale"] if scale is None else list(scale),
        }
        super().__init__(
            observation_space,
            action_space,
            lr_schedule,
            net_arch={"pi": [], "vf": self.critic_sizes},
            activation_fn=activation_fn,
            log_std_init=log_std_init,
            features_extractor_class=ScaledFeatures,
            features_extractor_kwargs=self.scaling,
            normalize_images=False,
            optimizer_class=optimizer_class,
            optimizer_kwargs=optimizer_kwargs,
        )

    def _build(self, lr_schedule: Any) -> None:
        """Make the tree, the critic and the optimizer, at the place where the parent makes its networks."""
        self.mlp_extractor = MlpExtractor(self.features_dim, self.net_arch, self.activation_fn, self.device)
        self.value_net = nn.Linear(self.mlp_extractor.latent_dim_vf, 1)
        self.mlp_extractor.apply(lambda module: self.init_weights(module, gain=np.sqrt(2)))
        self.init_weights(self.value_net, gain=1)
        num_outputs = action_spec(self.action_space).n_outputs
        self.action_net = TreeActor(
            self.depth, self.features_dim, num_outputs, self.threshold_std, self.surrogate
        )
        if isinstance(self.action_dist, DiagGaussianDistribution):
            self.log_std = nn.Parameter(torch.full((num_outputs,), float(self.log_std_init)))
        self.optimizer = self._optimizer(lr_schedule(1))

    def _optimizer(self, critic_rate: float) -> torch.optim.Optimizer:
        """A group of parameters for each learning rate, as a factor of the one that stable-baselines3 sets for all."""
        critic, groups = [], []
        for name, parameter in self.named_parameters():
            rate = self.learning_rates.get(name.removeprefix("action_net."))
            if rate is None:
                critic.append(parameter)
            else:
                # a policy that is loaded alone, to act, has a rate of zero
                groups.append({"params": [parameter], "factor": rate / critic_rate if critic_rate else 1.0})
        groups.append({"params": critic, "factor": 1.0})
        optimizer: Any = self.optimizer_class
        made = optimizer(groups, lr=critic_rate, **self.optimizer_kwargs)
        made.register_step_pre_hook(_apply_factors)
        made.register_step_post_hook(_take_factors_back)
        return made

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return {
            "observation_space": self.observation_space,
            "action_space": self.action_space,
            "lr_schedule": self._dummy_schedule,
            "depth": self.depth,
            "surrogate": self.surrogate,
            "threshold_std": self.threshold_std,
            "learning_rates": self.learning_rates,
            **self.scaling,
            "net_arch": self.critic_sizes,
            "activation_fn": self.activation_fn,
            "log_std_init": self.log_std_init,
            "optimizer_class": self.optimizer_class,
            "optimizer_kwargs": self.optimizer_kwargs,
        }

    def _predict(self, observation: Any, deterministic: bool = False) -> Tensor:
        """Act; deterministically by the leaf's values themselves, of which softmax might make equal chances."""
        if not deterministic:
            return super()._predict(observation)
        values = self.action_net(self.extract_features(observation))
        if isinstance(self.action_dist, DiagGaussianDistribution):
            return values
        if isinstance(self.action_dist, CategoricalDistribution):
            return values.argmax(dim=1)
        space: Any = self.action_space
        components = values.split(space.nvec.tolist(), dim=1)
        return torch.stack([component.argmax(dim=1) for component in components], dim=1)

    def to_tree(
        self,
        env: str | gymnasium.Env | EnvSpec | None = None,
        *,
        feature_names: Sequence[str] | None = None,
        action_names: Sequence[str] | None = None,
        groups: Sequence[Group] | None = None,
    ) -> DecisionTree:
        """Return the complete tree in raw units, which acts as ``predict(..., deterministic=True)`` does.

        Args:
            env: Whose names, groups and bounds the tree is to have; by default it has what the spaces say.
            feature_names: In their place, one a feature.
            action_names: One an action, or one a component of it.
            groups: The features that are one-hot together.

        Returns:
            The complete tree, not pruned.

        Raises:
            ValueError: the environment's spaces are not the policy's, or names do not fit.
        """
        features, actions, meta = self._metadata(env, feature_names, action_names, groups)
        if isinstance(actions, BoxActions):
            std = tuple(self.log_std.detach().exp().cpu().tolist())
            actions = BoxActions(actions.low, actions.high, actions.shape, actions.names, std)
        tree = self.action_net
        feature, threshold = select(tree.feature_logits.detach(), tree.thresholds.detach())
        extractor = self.features_extractor
        return raw_tree(
            feature.cpu().numpy(),
            threshold.cpu().numpy(),
            tree.leaf_values.detach().cpu().numpy(),
            extractor.shift.cpu().numpy(),
            extractor.scale.cpu().numpy(),
            actions=actions,
            meta=meta,
            **features.metadata(),
        )

    def _metadata(
        self,
        env: str | gymnasium.Env | EnvSpec | None,
        feature_names: Sequence[str] | None,
        action_names: Sequence[str] | None,
        groups: Sequence[Group] | None,
    ) -> tuple[Features, ActionSpec, dict[str, Any]]:
        """What readers of the tree are told of its features and actions."""
        if env is None:
            features = Features.of(self.observation_space, feature_names, groups)
            return features, action_spec(self.action_space, action_names), {}
        names: Any = {"feature_names": feature_names, "action_names": action_names, "groups": groups}
        if not isinstance(env, EnvSpec):
            env = resolve(env, backend="host", **names)
        elif any(names.values()):
            raise ValueError(
                "names and groups are the EnvSpec's own: give them to sympol.resolve, which made it"
            )
        for what in ("observation_space", "action_space"):
            if getattr(env, what) != getattr(self, what):
                raise ValueError(
                    f"the {what} of {env.name} is {getattr(env, what)}, but the policy was made for "
                    f"{getattr(self, what)}; give the environment it was trained on, wrappers included"
                )
        made = {name: value for name, value in env.origin.to_dict().items() if value}
        return env.features, env.actions, {"env": env.name, **made}


def _apply_factors(optimizer: torch.optim.Optimizer, *_: Any) -> None:
    for group in optimizer.param_groups:
        group["scheduled_lr"] = group["lr"]
        group["lr"] = group["lr"] * group["factor"]


def _take_factors_back(optimizer: torch.optim.Optimizer, *_: Any) -> None:
    for group in optimizer.param_groups:
        group["lr"] = group["scheduled_lr"]
