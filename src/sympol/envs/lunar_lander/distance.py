"""The distance of a body from an edge: GJK (Gilbert, Johnson and Keerthi 1988) as in Box2D, to the bit.

A simplex has a row for each of its vertices: the end of the edge, the corner of the body, their difference, and its
part of the nearest point; ``index`` says which end and which corner.
"""

from __future__ import annotations

import numpy as np

from .bodies import NUMBER, VERTICES
from .layout import HALF, ONE, ZERO, F
from .machine import compiled

EPSILON = F(np.finfo(np.float32).eps)
SUPPORTS = 20
"""The most iterations."""


@compiled
def at_corner(kind, i, at):
    """Return the position of a corner of the body."""
    px, py, sin, cos = at
    x, y = VERTICES[kind, i, 0], VERTICES[kind, i, 1]
    return (cos * x - sin * y) + px, (sin * x + cos * y) + py


@compiled
def edge_support(ends, dx, dy):
    """Return the end of the edge that is farthest in a direction."""
    return 1 if ends[1, 0] * dx + ends[1, 1] * dy > ends[0, 0] * dx + ends[0, 1] * dy else 0


@compiled
def body_support(kind, dx, dy):
    """Return the corner that is farthest in a direction of the body's frame."""
    best, most = 0, VERTICES[kind, 0, 0] * dx + VERTICES[kind, 0, 1] * dy
    for i in range(1, NUMBER[kind]):
        value = VERTICES[kind, i, 0] * dx + VERTICES[kind, i, 1] * dy
        if value > most:
            best, most = i, value
    return best


@compiled
def _vertex(simplex, index, i, a, b, ends, kind, at):
    """Write the i-th vertex: the difference of a corner of the body and an end of the edge."""
    x, y = at_corner(kind, b, at)
    index[i, 0], index[i, 1] = a, b
    simplex[i, 0], simplex[i, 1], simplex[i, 2], simplex[i, 3] = ends[a, 0], ends[a, 1], x, y
    simplex[i, 4], simplex[i, 5] = x - ends[a, 0], y - ends[a, 1]


@compiled
def _metric(simplex, count):
    """Return the length or area of a simplex, which tells whether it is still the same."""
    if count < 2:
        return ZERO
    ux, uy = simplex[1, 4] - simplex[0, 4], simplex[1, 5] - simplex[0, 5]
    if count == 2:
        ux, uy = simplex[0, 4] - simplex[1, 4], simplex[0, 5] - simplex[1, 5]
        return np.sqrt(ux * ux + uy * uy)
    wx, wy = simplex[2, 4] - simplex[0, 4], simplex[2, 5] - simplex[0, 5]
    return ux * wy - uy * wx


@compiled
def _move(simplex, index, to, of):
    """Copy one vertex to another's place."""
    for i in range(7):
        simplex[to, i] = simplex[of, i]
    index[to, 0], index[to, 1] = index[of, 0], index[of, 1]


@compiled
def _solve2(simplex, index):
    """Find the part of a segment that is nearest to the origin; return its number of vertices."""
    w1x, w1y, w2x, w2y = simplex[0, 4], simplex[0, 5], simplex[1, 4], simplex[1, 5]
    ex, ey = w2x - w1x, w2y - w1y
    d2 = -(w1x * ex + w1y * ey)
    if d2 <= ZERO:
        simplex[0, 6] = ONE
        return 1
    d1 = w2x * ex + w2y * ey
    if d1 <= ZERO:
        simplex[1, 6] = ONE
        _move(simplex, index, 0, 1)
        return 1
    whole = ONE / (d1 + d2)
    simplex[0, 6], simplex[1, 6] = d1 * whole, d2 * whole
    return 2


@compiled
def _solve3(simplex, index):
    """Find the part of a triangle that is nearest to the origin; return its number of vertices."""
    w1x, w1y, w2x, w2y = simplex[0, 4], simplex[0, 5], simplex[1, 4], simplex[1, 5]
    w3x, w3y = simplex[2, 4], simplex[2, 5]
    ex, ey = w2x - w1x, w2y - w1y
    d12_1, d12_2 = w2x * ex + w2y * ey, -(w1x * ex + w1y * ey)
    fx, fy = w3x - w1x, w3y - w1y
    d13_1, d13_2 = w3x * fx + w3y * fy, -(w1x * fx + w1y * fy)
    gx, gy = w3x - w2x, w3y - w2y
    d23_1, d23_2 = w3x * gx + w3y * gy, -(w2x * gx + w2y * gy)
    n = ex * fy - ey * fx
    d1, d2, d3 = n * (w2x * w3y - w2y * w3x), n * (w3x * w1y - w3y * w1x), n * (w1x * w2y - w1y * w2x)
    if d12_2 <= ZERO and d13_2 <= ZERO:
        simplex[0, 6] = ONE
        return 1
    if d12_1 > ZERO and d12_2 > ZERO and d3 <= ZERO:
        whole = ONE / (d12_1 + d12_2)
        simplex[0, 6], simplex[1, 6] = d12_1 * whole, d12_2 * whole
        return 2
    if d13_1 > ZERO and d13_2 > ZERO and d2 <= ZERO:
        whole = ONE / (d13_1 + d13_2)
        simplex[0, 6], simplex[2, 6] = d13_1 * whole, d13_2 * whole
        _move(simplex, index, 1, 2)
        return 2
    if d12_1 <= ZERO and d23_2 <= ZERO:
        simplex[1, 6] = ONE
        _move(simplex, index, 0, 1)
        return 1
    if d13_1 <= ZERO and d23_1 <= ZERO:
        simplex[2, 6] = ONE
        _move(simplex, index, 0, 2)
        return 1
    if d23_1 > ZERO and d23_2 > ZERO and d1 <= ZERO:
        whole = ONE / (d23_1 + d23_2)
        simplex[1, 6], simplex[2, 6] = d23_1 * whole, d23_2 * whole
        _move(simplex, index, 0, 2)
        return 2
    whole = ONE / (d1 + d2 + d3)
    simplex[0, 6], simplex[1, 6], simplex[2, 6] = d1 * whole, d2 * whole, d3 * whole
    return 3


@compiled
def distance(simplex, index, count, metric, ends, kind, at):
    """Return the distance between the shapes without their skins, and count and metric of the last simplex."""
    for i in range(count):
        _vertex(simplex, index, i, index[i, 0], index[i, 1], ends, kind, at)
        simplex[i, 6] = ZERO
    if count > 1:
        now = _metric(simplex, count)
        if now < HALF * metric or F(2) * metric < now or now < EPSILON:
            count = 0
    if count == 0:
        _vertex(simplex, index, 0, 0, 0, ends, kind, at)
        simplex[0, 6] = ONE
        count = 1
    _, _, sin, cos = at
    before = np.empty((3, 2), np.int64)
    for _ in range(SUPPORTS):
        known = count
        for i in range(known):
            before[i, 0], before[i, 1] = index[i, 0], index[i, 1]
        if count == 2:
            count = _solve2(simplex, index)
        elif count == 3:
            count = _solve3(simplex, index)
        if count == 3:
            break
        if count == 1:
            dx, dy = -simplex[0, 4], -simplex[0, 5]
        else:
            ex, ey = simplex[1, 4] - simplex[0, 4], simplex[1, 5] - simplex[0, 5]
            dx, dy = (-ey, ex) if ex * -simplex[0, 5] - ey * -simplex[0, 4] > 0 else (ey, -ex)
        if dx * dx + dy * dy < EPSILON * EPSILON:
            break
        a = edge_support(ends, -dx, -dy)
        b = body_support(kind, cos * dx + sin * dy, -sin * dx + cos * dy)
        _vertex(simplex, index, count, a, b, ends, kind, at)
        again = False
        for i in range(known):
            again = again or (a == before[i, 0] and b == before[i, 1])
        if again:
            break
        count += 1
    if count == 3:
        apart = ZERO
    elif count == 1:
        dx, dy = simplex[0, 0] - simplex[0, 2], simplex[0, 1] - simplex[0, 3]
        apart = np.sqrt(dx * dx + dy * dy)
    else:
        u, v = simplex[0, 6], simplex[1, 6]
        dx = (u * simplex[0, 0] + v * simplex[1, 0]) - (u * simplex[0, 2] + v * simplex[1, 2])
        dy = (u * simplex[0, 1] + v * simplex[1, 1]) - (u * simplex[0, 3] + v * simplex[1, 3])
        apart = np.sqrt(dx * dx + dy * dy)
    return apart, count, _metric(simplex, count)
