"""Gymnasium's lunar landers in machine code: the same episodes to the bit, some ten times as fast.

Box2D's rigid bodies, joints, contacts and times of impact are written anew for what flies here, three bodies above
ground that does not move. It needs Numba.
"""
