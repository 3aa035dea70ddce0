import numpy as np
import pytest

from sympol.trees import BoxActions, DecisionTree, DiscreteActions


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
