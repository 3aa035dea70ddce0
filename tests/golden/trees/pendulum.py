"""A decision tree policy, written by sympol. It needs nothing but Python.

act(observation) takes one number per feature, in the order of FEATURES, and returns a list of floats.
The tree compares float32 numbers. Thresholds are written so that comparing float (and float32) numbers with them
decides the same: each is the largest float that rounds to what its comment says.
"""

FEATURES = (
    'cos \u03b8',
    'sin \u03b8',
    'angular velocity',
)


def act(observation):
    try:
        [cos, sin, angular_velocity] = observation
    except ValueError:
        raise ValueError(f"expected {len(FEATURES)} numbers {FEATURES}, got {observation}") from None
    if sin <= 1.1754942807573642e-38:  # sin θ ≤ 0
        return [0.5299999713897705]  # torque = 0.53
    return [-2.0]  # torque = -2


if __name__ == "__main__":
    import sys

    print(act([float(argument) for argument in sys.argv[1:]]))
