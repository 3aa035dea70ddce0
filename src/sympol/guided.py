"""The training of a tree with a teacher: `Config.method` is ``"auto"``.

Gradients of a tree get stuck where two splits are worth something only together, where rewards are sparse, and where
features are one-hot; those of an MLP do not. So an MLP is trained for the first part of the steps. A tree is distilled
from it, the smallest that is about as good as any. From then on this tree acts, learns and grows, with the teacher's
critic, for the rest of the steps. Where the teacher earns no more than random actions there is nothing to distill, and
the tree begins as a single leaf.

All this is one training with one clock: its state is at first that of the teacher, then that of the tree, and every
step that the teacher or the distillation takes counts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .algorithms.config import Config
from .algorithms.knobs import ConfigError
from .algorithms.metrics import require_finite
from .algorithms.state import Guide, Networks, TrainState
from .algorithms.teaching import distilling_steps, teacher_config, teacher_stops
from .algorithms.trainer import Trainer, make_loop, make_trainer
from .algorithms.warm_start import Start
from .distill.dataset import Limits
from .distill.teacher import Teacher, log_softmax
from .distill.within_steps import distill_within
from .envs.errors import EnvironmentFailure
from .envs.spec import EnvSpec
from .trained_policy import TrainedPolicy
from .trees import DecisionTree
from .trees.actions import BoxActions

EXPLORED = 0.2
"""The part of a uniform distribution that every action of a leaf of the distilled tree has at least."""


class GuidedTrainer:
    """The training of one seed with a teacher; it has the methods of a `Trainer`.

    Args:
        spec: The environment.
        config: The configuration, whose method is "auto".
        seed: The seed of everything random.
    """

    def __init__(self, spec: EnvSpec, config: Config, seed: int) -> None:
        if teacher_stops(config)[-1] >= config.total_timesteps:
            raise ConfigError(
                f"num_evals must be at least 2 with method auto, got {config.num_evals}: the teacher is validated "
                "before a tree is distilled from it"
            )
        self._spec, self._config, self._seed = spec, config, seed
        self._taught = teacher_config(spec.preset_id, config)
        self._teacher = make_trainer(spec, self._taught, seed)
        self._tree = make_trainer(spec, config, seed, guided=True)
        self._active = self._teacher
        self.say: Callable[[str], None] = lambda words: None
        """Called with what is being done when it is no training."""

    @property
    def latest(self) -> TrainState | None:
        """See `Trainer.latest`."""
        return self._active.latest

    @property
    def limit(self) -> int:
        """See `Trainer.limit`."""
        return self._active.limit

    @property
    def was_cut(self) -> bool:
        """See `Trainer.was_cut`."""
        return self._active.was_cut

    def compile(self) -> float:
        """Compile the programs of the teacher and of the tree; see `Trainer.compile`."""
        return self._teacher.compile() + self._tree.compile()

    def advance(self, state: TrainState | None, stop: int) -> TrainState:
        """Train until a timestep is reached, and validate; see `Trainer.advance`.

        When the teacher is trained, this distills a tree, and returns the state of its training before the first step.
        """
        if state is not None and state.guide is not None:
            return self._run(self._tree, state, stop)
        state = self._run(self._teacher, state, stop)
        if int(state.timestep) < self._taught.total_timesteps:
            return state
        require_finite(state, self._taught.total_timesteps, self._spec.features.names)
        self._teacher.close()  # there may be no more copies of the environment than it has open
        self.say("distilling a tree from the teacher")
        try:
            self._tree.begin_with(**self._beginning(state))
        except Exception as error:
            raise EnvironmentFailure(
                f"in the episodes of distillation, after {int(state.timestep):,} steps of training: "
                f"{type(error).__name__}: {error}"
            ) from error
        return self._run(self._tree, None, 0)

    def close(self) -> None:
        """See `Trainer.close`."""
        self._teacher.close()
        self._tree.close()

    def _run(self, trainer: Trainer, state: TrainState | None, stop: int) -> TrainState:
        self._active = trainer
        return trainer.advance(state, stop)

    def _beginning(self, state: TrainState) -> dict[str, Any]:
        """Return what the training of the tree begins with, given the state of the trained teacher."""
        spec, config, seed = self._spec, self._config, self._seed
        policy = TrainedPolicy(spec, self._taught, seed, state)
        limits = Limits(config.depth, config.max_nodes or None)
        found = distill_within(
            Teacher.from_outputs(spec, policy.outputs), distilling_steps(config), limits=limits, seed=seed
        )
        tree = found.tree.prune(observations=spec.all_observations())
        actor, warm = (
            Start(with_exploration(tree), confidence=1.0, critic_warmup=0.0)
            .fitted(spec)
            .parameters(config, seed, spec.action_space)
        )
        actor = eqx.tree_at(lambda a: a.log_std, actor, np.asarray(state.networks.actor.log_std))
        steps = jnp.int32(int(state.timestep) + found.num_steps)
        guide = Guide(
            steps=steps,
            teacher_steps=jnp.int32(state.timestep),
            teacher_return=jnp.float32(found.teacher_return),
            random_return=jnp.float32(found.random_return),
            tree_return=jnp.float32(found.tree_return),
            tree_length=jnp.float32(found.tree_length),
            is_distilled=jnp.bool_(found.teacher_is_better),
            scale=state.normalizer,
        )
        networks = Networks(actor, state.networks.critic)
        memory = self._tree.template().memory._replace(returns=state.memory.returns)
        return {"networks": networks, "memory": memory, "timestep": steps, "warm": warm, "guide": guide}


def trainer_of(spec: EnvSpec, config: Config, seed: int, start: Start | None) -> Trainer | GuidedTrainer:
    """Return the trainer of a configuration, with a teacher if its method is "auto".

    Args:
        spec: The environment.
        config: The configuration.
        seed: The seed of everything random.
        start: The tree to start from, if there is one.

    Returns:
        The trainer; it opens no environment before it is asked to advance.

    Raises:
        ConfigError: The configuration needs devices that there are not, or leaves no steps for the tree.
    """
    if config.method == "auto":
        return GuidedTrainer(spec, config, seed)
    return make_trainer(spec, config, seed, start)


def saved_template(spec: EnvSpec, config: Config, start: Start | None, timestep: int) -> TrainState:
    """Return a state of zeros in the form that the training has at a timestep, to load a checkpoint into.

    Args:
        spec: The environment, which is not opened.
        config: The configuration.
        start: The tree that the training starts from, if there is one.
        timestep: The environment steps so far.

    Returns:
        The state.
    """
    is_guided = config.method == "auto"
    if is_guided and timestep < teacher_stops(config)[-1]:
        config, is_guided = teacher_config(spec.preset_id, config), False
    source = spec if spec.env is None else spec.env
    return make_loop(source, config.static(), warm=is_guided or start is not None).saved_template()


def with_exploration(tree: DecisionTree) -> DecisionTree:
    """Return a tree whose leaves give no action less than `EXPLORED` of its share in a uniform distribution.

    A leaf in which the teacher never took an action would never try it.

    Args:
        tree: The tree.

    Returns:
        The tree, with the same best actions; one of continuous actions is returned as it is.
    """
    actions = tree.actions
    if isinstance(actions, BoxActions):
        return tree
    outputs = tree.leaf_outputs.astype(np.float64)
    parts = actions.split(outputs)
    floors = [np.log(EXPLORED / part.shape[1]) for part in parts]
    raised = [np.maximum(log_softmax(part), floor) for part, floor in zip(parts, floors, strict=True)]
    return replace(tree, value=np.where(tree.is_leaf[:, None], np.concatenate(raised, axis=1), 0))
