"""A decision tree policy, written by sympol. It needs nothing but Python.

act(observation) takes one number a feature, in the order of FEATURES, and returns an int.
"""

from array import array

FEATURES = (
    'speed',
    'front is empty',
    'front is wall',
    'front is lava',
    'front is goal',
    'steps',
)

# choices: the name, the features of which exactly one is 1 and the others are 0, and what each says when it is 1
GROUPS = (
    ('front', (1, 2, 3, 4), ('empty', 'wall', 'lava', 'goal')),
)


def act(observation):
    # the tree compares float32 numbers, so the observation is rounded to float32 first
    x = array("f", list(observation))
    if len(x) != len(FEATURES):
        raise ValueError(f"expected {len(FEATURES)} numbers {FEATURES}, got {len(x)}")
    return _node_0(x, _seen(x))


def _seen(x):
    see = {}
    for name, features, categories in GROUPS:
        values = [x[feature] for feature in features]
        # as to the tree, a number below float32's normal range is 0
        if values.count(1) != 1 or sum(abs(value) < 2.0**-126 for value in values) != len(values) - 1:
            raise ValueError(f"{name!r} must be a single 1 and otherwise 0, got {values} in {x.tolist()}")
        see[name] = categories[values.index(1)]
    return see


def _node_0(x, see):
    if see['front'] == 'lava':
        if x[5] <= 0.25:  # steps ≤ 0.25
            if see['front'] == 'empty':
                return 1  # turn right
            else:
                return 1  # turn right
        elif see['front'] == 'empty':
            return 1  # turn right
        else:
            return 1  # turn right
    elif see['front'] == 'wall':
        if see['front'] == 'wall':
            return 0  # turn left
        else:
            return 2  # move forward
    elif x[0] <= -0.10000000149011612:  # speed ≤ -0.1
        return 0  # turn left
    else:
        return 1  # turn right


if __name__ == "__main__":
    import sys

    print(act([float(argument) for argument in sys.argv[1:]]))
