import numpy as np
import pytest

from sympol.trees import BoxActions, DecisionTree, DiscreteActions, Group


@pytest.fixture
def cartpole() -> DecisionTree:
    """A policy small enough to write down."""
    tree = DecisionTree.from_complete(
        np.array([3, 2, 2]),
        np.array([-0.05, 0.021, -0.1]),
        np.array([[2.0, 0.0], [0.0, 1.0], [1.0, 0.0], [0.0, 3.0]]),
        actions=DiscreteActions(2, ("push left", "push right")),
        feature_names=["cart position", "cart velocity", "pole angle", "pole angular velocity"],
        feature_low=[-4.8, -np.inf, -0.41887903, -np.inf],
        feature_high=[4.8, np.inf, 0.41887903, np.inf],
        meta={"env": "CartPole-v1"},
    )
    pole = np.array([[0.0, -1.0]] * 4 + [[0.1, -1.0], [-0.2, 0.0]] + [[0.0, 0.0]] * 4)
    return tree.with_visits(np.column_stack([np.zeros((10, 2)), pole]))


@pytest.fixture
def pendulum() -> DecisionTree:
    """A policy with a continuous action."""
    return DecisionTree.from_complete(
        np.array([1]),
        np.array([0.0]),
        np.array([[0.53], [-7.0]]),
        actions=BoxActions(-2, 2, (1,), ("torque",), std=(0.5,)),
        feature_names=["cos θ", "sin θ", "angular velocity"],
    )


@pytest.fixture
def front() -> DecisionTree:
    """A policy that asks about a group and about a number, and twice what it knows already."""
    tree = DecisionTree.from_complete(
        np.array([3, 2, 5, 0, 2, 1, 1]),
        np.array([0.5, 0.0, 0.25, -0.1, 0.5, 0.5, 0.5]),
        np.eye(3)[[0, 1, 2, 0, 1, 1, 1, 1]],
        actions=DiscreteActions(3, ("turn left", "turn right", "move forward")),
        feature_names=["speed", "front is empty", "front is wall", "front is lava", "front is goal", "steps"],
        feature_low=[-1, 0, 0, 0, 0, 0],
        feature_high=[1, 1, 1, 1, 1, np.inf],
        groups=[Group("front", (1, 2, 3, 4), ("empty", "wall", "lava", "goal"), cell=(0, 1))],
    )
    seen = np.eye(4)[[0, 0, 3, 1, 1, 2, 2, 2]]
    return tree.with_visits(np.column_stack([np.linspace(-1, 1, 8), seen, np.arange(8) / 4]))
