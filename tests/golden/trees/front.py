"""A decision tree policy, written by sympol. It needs nothing but Python.

act(observation) takes one number per feature, in the order of FEATURES, and returns an int.
The tree compares float32 numbers. Thresholds are written so that comparing float (and float32) numbers with them
decides the same: each is the largest float that rounds to what its comment says.
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


def _seen(x):
    see = {}
    for name, features, categories in GROUPS:
        values = [x[feature] for feature in features]
        if values.count(1) != 1 or values.count(0) != len(values) - 1:
            # to the tree they are float32 numbers, and below float32's normal range they are 0
            values = [value if abs(value) >= 2.0**-126 else value * 0.0 for value in array("f", values)]
            if values.count(1) != 1 or values.count(0) != len(values) - 1:
                raise ValueError(f"{name!r} must be a single 1 and otherwise 0, got {values} in {x}")
        see[name] = categories[values.index(1)]
    return see


def act(observation):
    x = list(observation)
    if len(x) != len(FEATURES):
        raise ValueError(f"expected {len(FEATURES)} numbers {FEATURES}, got {len(x)}")
    see = _seen(x)
    if see['front'] == 'lava':
        if x[5] <= 0.2500000149011612:  # steps ≤ 0.25
            if see['front'] == 'empty':
                return 1  # turn right
            return 1  # turn right
        if see['front'] == 'empty':
            return 1  # turn right
        return 1  # turn right
    if see['front'] == 'wall':
        if see['front'] == 'wall':
            return 0  # turn left
        return 2  # move forward
    if x[0] <= -0.09999999776482583:  # speed ≤ -0.1
        return 0  # turn left
    return 1  # turn right


if __name__ == "__main__":
    import sys

    print(act([float(argument) for argument in sys.argv[1:]]))
