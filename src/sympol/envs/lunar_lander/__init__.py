"""Gymnasium's lunar landers in machine code: the same episodes to the bit, some ten times as fast.

Box2D's rigid bodies, joints, contacts and times of impact are reimplemented for the three bodies of a lander above
ground that does not move. It needs Numba.
"""
