"""A decision tree policy, written by sympol. It needs nothing but Python.

act(observation) takes one number per feature, in the order of FEATURES, and returns an int.
The tree compares float32 numbers. Thresholds are written so that comparing float (and float32) numbers with them
decides the same: each is the largest float that rounds to what its comment says.
"""

from array import array

FEATURES = (
    '2 ahead, 1 left is unseen',
    '2 ahead, 1 left is empty',
    '2 ahead, 1 left is wall',
    '2 ahead, 1 left is goal',
    '2 ahead, 1 left is lava',
    'front-left is unseen',
    'front-left is empty',
    'front-left is wall',
    'front-left is goal',
    'front-left is lava',
    'left is unseen',
    'left is empty',
    'left is wall',
    'left is goal',
    'left is lava',
    '2 ahead is unseen',
    '2 ahead is empty',
    '2 ahead is wall',
    '2 ahead is goal',
    '2 ahead is lava',
    'front is unseen',
    'front is empty',
    'front is wall',
    'front is goal',
    'front is lava',
    'here is unseen',
    'here is empty',
    'here is wall',
    'here is goal',
    'here is lava',
    '2 ahead, 1 right is unseen',
    '2 ahead, 1 right is empty',
    '2 ahead, 1 right is wall',
    '2 ahead, 1 right is goal',
    '2 ahead, 1 right is lava',
    'front-right is unseen',
    'front-right is empty',
    'front-right is wall',
    'front-right is goal',
    'front-right is lava',
    'right is unseen',
    'right is empty',
    'right is wall',
    'right is goal',
    'right is lava',
)

# choices: the name, the features of which exactly one is 1 and the others are 0, and what each says when it is 1
GROUPS = (
    ('2 ahead, 1 left', (0, 1, 2, 3, 4), ('unseen', 'empty', 'wall', 'goal', 'lava')),
    ('front-left', (5, 6, 7, 8, 9), ('unseen', 'empty', 'wall', 'goal', 'lava')),
    ('left', (10, 11, 12, 13, 14), ('unseen', 'empty', 'wall', 'goal', 'lava')),
    ('2 ahead', (15, 16, 17, 18, 19), ('unseen', 'empty', 'wall', 'goal', 'lava')),
    ('front', (20, 21, 22, 23, 24), ('unseen', 'empty', 'wall', 'goal', 'lava')),
    ('here', (25, 26, 27, 28, 29), ('unseen', 'empty', 'wall', 'goal', 'lava')),
    ('2 ahead, 1 right', (30, 31, 32, 33, 34), ('unseen', 'empty', 'wall', 'goal', 'lava')),
    ('front-right', (35, 36, 37, 38, 39), ('unseen', 'empty', 'wall', 'goal', 'lava')),
    ('right', (40, 41, 42, 43, 44), ('unseen', 'empty', 'wall', 'goal', 'lava')),
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
    if see['2 ahead'] == 'lava':
        if see['front'] == 'lava':
            return 1  # turn right
        return 2  # move forward
    if see['front'] == 'goal':
        return 2  # move forward
    if see['right'] == 'goal':
        if see['front'] == 'wall':
            if see['left'] == 'lava':
                return 1  # turn right
            if see['left'] == 'empty':
                return 1  # turn right
            return 2  # move forward
        return 1  # turn right
    if see['front-right'] == 'goal':
        return 2  # move forward
    if see['left'] == 'goal':
        return 0  # turn left
    if see['2 ahead, 1 left'] == 'wall':
        if see['2 ahead, 1 right'] == 'wall':
            return 0  # turn left
        return 1  # turn right
    return 2  # move forward


if __name__ == "__main__":
    import sys

    print(act([float(argument) for argument in sys.argv[1:]]))
