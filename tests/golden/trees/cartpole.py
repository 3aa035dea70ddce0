"""A decision tree policy, written by sympol. It needs nothing but Python.

act(observation) takes one number per feature, in the order of FEATURES, and returns an int.
The tree compares float32 numbers. Thresholds are written so that comparing float (and float32) numbers with them
decides the same: each is the largest float that rounds to what its comment says.
"""

FEATURES = (
    'cart position',
    'cart velocity',
    'pole angle',
    'pole angular velocity',
)


def act(observation):
    try:
        [cart_position, cart_velocity, pole_angle, pole_angular_velocity] = observation
    except ValueError:
        raise ValueError(f"expected {len(FEATURES)} numbers {FEATURES}, got {observation}") from None
    if pole_angular_velocity <= -0.04999999888241292:  # pole angular velocity ≤ -0.05
        if pole_angle <= 0.02100000064820051:  # pole angle ≤ 0.021
            return 0  # push left
        return 1  # push right
    if pole_angle <= -0.09999999776482583:  # pole angle ≤ -0.1
        return 0  # push left
    return 1  # push right


if __name__ == "__main__":
    import sys

    print(act([float(argument) for argument in sys.argv[1:]]))
