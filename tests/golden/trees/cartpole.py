"""A decision tree policy, written by sympol. It needs nothing but Python.

act(observation) takes one number a feature, in the order of FEATURES, and returns an int.
"""

from array import array

FEATURES = (
    'cart position',
    'cart velocity',
    'pole angle',
    'pole angular velocity',
)


def act(observation):
    # the tree compares float32 numbers, so the observation is rounded to float32 first
    x = array("f", list(observation))
    if len(x) != len(FEATURES):
        raise ValueError(f"expected {len(FEATURES)} numbers {FEATURES}, got {len(x)}")
    return _node_0(x)


def _node_0(x):
    if x[3] <= -0.05000000074505806:  # pole angular velocity ≤ -0.05
        if x[2] <= 0.020999999716877937:  # pole angle ≤ 0.021
            return 0  # push left
        else:
            return 1  # push right
    else:
        if x[2] <= -0.10000000149011612:  # pole angle ≤ -0.1
            return 0  # push left
        else:
            return 1  # push right


if __name__ == "__main__":
    import sys

    print(act([float(argument) for argument in sys.argv[1:]]))
