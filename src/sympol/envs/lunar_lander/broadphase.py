"""Find bodies that are near to edges: Box2D's fat bounding boxes, renewed where a body has left its own."""

from __future__ import annotations

import numpy as np

from .bodies import FARTHEST, NUMBER, SKIN, VERTICES, rotated
from .layout import ZERO, F
from .machine import compiled

EXTENSION, AHEAD = F(0.1), F(2)
"""The margin of a fat box on all sides, and the number of steps that it reaches ahead."""


@compiled
def _bounds(px, py, sin, cos, kind):
    """Return the bounding box of a body in a pose."""
    low_x = low_y = FARTHEST
    high_x = high_y = -FARTHEST
    for i in range(NUMBER[kind]):
        x, y = rotated(sin, cos, VERTICES[kind, i, 0], VERTICES[kind, i, 1])
        x, y = x + px, y + py
        low_x, low_y = min(low_x, x), min(low_y, y)
        high_x, high_y = max(high_x, x), max(high_y, y)
    return low_x - SKIN, low_y - SKIN, high_x + SKIN, high_y + SKIN


@compiled
def init_box(body, kind):
    """Set the first fat box of a body."""
    low_x, low_y, high_x, high_y = _bounds(body.px, body.py, body.sin, body.cos, kind)
    body.low_x, body.low_y = low_x - EXTENSION, low_y - EXTENSION
    body.high_x, body.high_y = high_x + EXTENSION, high_y + EXTENSION


@compiled
def update_box(body, kind, center_x, center_y):
    """Renew the fat box of a body whose sweep has left it; return whether it was renewed."""
    sin, cos = np.sin(body.angle0), np.cos(body.angle0)
    x, y = rotated(sin, cos, center_x, center_y)
    px, py = body.cx0 - x, body.cy0 - y
    l1x, l1y, h1x, h1y = _bounds(px, py, sin, cos, kind)
    l2x, l2y, h2x, h2y = _bounds(body.px, body.py, body.sin, body.cos, kind)
    low_x, low_y, high_x, high_y = min(l1x, l2x), min(l1y, l2y), max(h1x, h2x), max(h1y, h2y)
    if body.low_x <= low_x and body.low_y <= low_y and high_x <= body.high_x and high_y <= body.high_y:
        return False
    dx, dy = AHEAD * (body.px - px), AHEAD * (body.py - py)
    body.low_x, body.low_y = low_x - EXTENSION, low_y - EXTENSION
    body.high_x, body.high_y = high_x + EXTENSION, high_y + EXTENSION
    if dx < ZERO:
        body.low_x += dx
    else:
        body.high_x += dx
    if dy < ZERO:
        body.low_y += dy
    else:
        body.high_y += dy
    return True


@compiled
def boxes_overlap(body, edge):
    """Return whether the fat boxes of a body and an edge overlap."""
    return not (
        edge.low_x - body.high_x > 0
        or edge.low_y - body.high_y > 0
        or body.low_x - edge.high_x > 0
        or body.low_y - edge.high_y > 0
    )
