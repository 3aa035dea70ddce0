"""A decision tree policy, written by sympol. It needs nothing but Python.

act(observation) takes one number a feature, in the order of FEATURES, and returns a list of floats.
"""

from array import array

FEATURES = (
    'cos \u03b8',
    'sin \u03b8',
    'angular velocity',
)


def act(observation):
    # the tree compares float32 numbers, so the observation is rounded to float32 first
    x = array("f", list(observation))
    if len(x) != len(FEATURES):
        raise ValueError(f"expected {len(FEATURES)} numbers {FEATURES}, got {len(x)}")
    return _node_0(x)


def _node_0(x):
    if x[1] <= 1.1754942106924411e-38:  # sin θ ≤ 0
        return [0.5299999713897705]  # torque = 0.53
    else:
        return [-2.0]  # torque = -2


if __name__ == "__main__":
    import sys

    print(act([float(argument) for argument in sys.argv[1:]]))
