"""When, within a step, a body comes to an edge: Box2D's conservative advancement over separating axes, to the bit.

The distance between a body and an edge is GJK's (Gilbert, Johnson and Keerthi 1988); the edge does not move.
"""

from __future__ import annotations

import math

import numpy as np

from .collide import NUMBER, RADIUS, VERTICES, rotated
from .layout import HALF, ONE, ZERO, F
from .machine import compiled
from .solve import CENTERS, SLOP

TARGET = max(SLOP, RADIUS - F(3) * SLOP)
"""How near they come at the time of impact."""
TOLERANCE = F(0.25) * SLOP
EPSILON = F(np.finfo(np.float32).eps)
TWO_PI = F(2) * F(3.14159265359)
AXES, PUSHES, ROOTS, SUPPORTS = 20, 16, 50, 20
"""Iterations at most: of separating axes, of deepest points along one, of its root, and of GJK."""
POINTS, EDGE_FACE, BODY_FACE = 0, 1, 2
"""What a separating axis is made of."""
NEAR = TARGET + F(2) * TOLERANCE
REACH = F(0.8)
"""From the centre of mass to the farthest corner, at most."""


@compiled
def pose(sweep, beta):
    """Origin and rotation at a part of a sweep, which is start, end and centre of mass."""
    cx0, cy0, angle0, cx, cy, angle, mx, my = sweep
    turn = (ONE - beta) * angle0 + beta * angle
    sin, cos = np.sin(turn), np.cos(turn)
    x, y = rotated(sin, cos, mx, my)
    return ((ONE - beta) * cx0 + beta * cx) - x, ((ONE - beta) * cy0 + beta * cy) - y, sin, cos


@compiled
def _at(kind, i, at):
    """A corner of the body."""
    px, py, sin, cos = at
    x, y = VERTICES[kind, i, 0], VERTICES[kind, i, 1]
    return (cos * x - sin * y) + px, (sin * x + cos * y) + py


@compiled
def _edge_support(ends, dx, dy):
    """The end of the edge that is farthest in a direction."""
    return 1 if ends[1, 0] * dx + ends[1, 1] * dy > ends[0, 0] * dx + ends[0, 1] * dy else 0


@compiled
def _body_support(kind, dx, dy):
    """The corner that is farthest in a direction of the body's frame."""
    best, most = 0, VERTICES[kind, 0, 0] * dx + VERTICES[kind, 0, 1] * dy
    for i in range(1, NUMBER[kind]):
        value = VERTICES[kind, i, 0] * dx + VERTICES[kind, i, 1] * dy
        if value > most:
            best, most = i, value
    return best


@compiled
def _vertex(simplex, index, i, a, b, ends, kind, at):
    """Write the i-th vertex: the difference of a corner of the body and an end of the edge."""
    x, y = _at(kind, b, at)
    index[i, 0], index[i, 1] = a, b
    simplex[i, 0], simplex[i, 1], simplex[i, 2], simplex[i, 3] = ends[a, 0], ends[a, 1], x, y
    simplex[i, 4], simplex[i, 5] = x - ends[a, 0], y - ends[a, 1]


@compiled
def _metric(simplex, count):
    """Length or area, by which one sees whether a simplex is still the same."""
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
    """One vertex in another's place."""
    for i in range(7):
        simplex[to, i] = simplex[of, i]
    index[to, 0], index[to, 1] = index[of, 0], index[of, 1]


@compiled
def _solve2(simplex, index):
    """The part of a segment that is nearest to the origin; how many vertices it takes."""
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
    """The part of a triangle that is nearest to the origin; how many vertices it takes."""
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
def _distance(simplex, index, count, metric, ends, kind, at):
    """Between cores, without skins. Return it, and of the last simplex its count and metric."""
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
        a = _edge_support(ends, -dx, -dy)
        b = _body_support(kind, cos * dx + sin * dy, -sin * dx + cos * dy)
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


@compiled
def _unit(x, y):
    """A direction of length one, unless it has none."""
    length = np.sqrt(x * x + y * y)
    if length < EPSILON:
        return x, y
    part = ONE / length
    return x * part, y * part


@compiled
def _axis(simplex, index, count, ends, kind, at):
    """What separates them: its kind, the axis in the frame of its face, and a point of that face."""
    px, py, sin, cos = at
    if count == 1:
        x, y = _at(kind, index[0, 1], at)
        ax, ay = _unit(x - ends[index[0, 0], 0], y - ends[index[0, 0], 1])
        return POINTS, ax, ay, ZERO, ZERO
    if index[0, 0] == index[1, 0]:
        x1, y1 = VERTICES[kind, index[0, 1], 0], VERTICES[kind, index[0, 1], 1]
        x2, y2 = VERTICES[kind, index[1, 1], 0], VERTICES[kind, index[1, 1], 1]
        ax, ay = _unit(y2 - y1, -(x2 - x1))
        nx, ny = rotated(sin, cos, ax, ay)
        mx, my = HALF * (x1 + x2), HALF * (y1 + y2)
        x, y = (cos * mx - sin * my) + px, (sin * mx + cos * my) + py
        if (ends[index[0, 0], 0] - x) * nx + (ends[index[0, 0], 1] - y) * ny < 0:
            ax, ay = -ax, -ay
        return BODY_FACE, ax, ay, mx, my
    x1, y1, x2, y2 = ends[index[0, 0], 0], ends[index[0, 0], 1], ends[index[1, 0], 0], ends[index[1, 0], 1]
    ax, ay = _unit(y2 - y1, -(x2 - x1))
    mx, my = HALF * (x1 + x2), HALF * (y1 + y2)
    x, y = _at(kind, index[0, 1], at)
    if (x - mx) * ax + (y - my) * ay < 0:
        ax, ay = -ax, -ay
    return EDGE_FACE, ax, ay, mx, my


@compiled
def _deepest(axis, ends, kind, at):
    """The end and the corner that are deepest along an axis."""
    face, ax, ay, _, _ = axis
    _, _, sin, cos = at
    if face == BODY_FACE:
        nx, ny = rotated(sin, cos, ax, ay)
        return _edge_support(ends, -nx, -ny), 0
    b = _body_support(kind, cos * -ax + sin * -ay, -sin * -ax + cos * -ay)
    return (_edge_support(ends, ax, ay) if face == POINTS else 0), b


@compiled
def _separation(axis, a, b, ends, kind, at):
    """Along an axis, of an end and a corner."""
    face, ax, ay, mx, my = axis
    px, py, sin, cos = at
    if face == BODY_FACE:
        nx, ny = rotated(sin, cos, ax, ay)
        x, y = (cos * mx - sin * my) + px, (sin * mx + cos * my) + py
        return (ends[a, 0] - x) * nx + (ends[a, 1] - y) * ny
    x, y = _at(kind, b, at)
    if face == POINTS:
        mx, my = ends[a, 0], ends[a, 1]
    return (x - mx) * ax + (y - my) * ay


@compiled
def _never(edge, kind, sweep):
    """Whether they stay too far apart to meet: all corners begin on one side, farther away than any of them moves."""
    cx0, cy0, angle0, cx, cy, angle, _, _ = sweep
    moves = abs(cx - cx0) + abs(cy - cy0) + REACH * abs(angle - angle0)
    at = pose(sweep, ZERO)
    low = high = ZERO
    for i in range(NUMBER[kind]):
        x, y = _at(kind, i, at)
        s = (x - edge.x1) * edge.nx + (y - edge.y1) * edge.ny
        low, high = (s, s) if i == 0 else (min(low, s), max(high, s))
    return (
        low - moves > NEAR
        or high + moves < -NEAR
        or cx0 + REACH + moves < edge.x1
        or edge.x2 < cx0 - REACH - moves
    )


@compiled
def time_of_impact(edge, kind, cx0, cy0, angle0, cx, cy, angle):
    """The part of the sweep after which a body touches an edge; 1 where it does not, or did before."""
    turn = TWO_PI * F(math.floor(angle0 / TWO_PI))
    sweep = (cx0, cy0, angle0 - turn, cx, cy, angle - turn, CENTERS[kind, 0], CENTERS[kind, 1])
    if _never(edge, kind, sweep):
        return ONE
    ends = np.empty((2, 2), np.float32)
    ends[0, 0], ends[0, 1], ends[1, 0], ends[1, 1] = edge.x1, edge.y1, edge.x2, edge.y2
    simplex, index = np.empty((4, 7), np.float32), np.zeros((4, 2), np.int64)
    count, metric, t1 = 0, ZERO, ZERO
    for _ in range(AXES):
        at = pose(sweep, t1)
        apart, count, metric = _distance(simplex, index, count, metric, ends, kind, at)
        if apart <= ZERO:
            return ONE
        if apart < TARGET + TOLERANCE:
            return t1
        axis = _axis(simplex, index, count, ends, kind, at)
        t2 = ONE
        for _ in range(PUSHES):
            at = pose(sweep, t2)
            a, b = _deepest(axis, ends, kind, at)
            s2 = _separation(axis, a, b, ends, kind, at)
            if s2 > TARGET + TOLERANCE:
                return ONE
            if s2 > TARGET - TOLERANCE:
                t1 = t2
                break
            s1 = _separation(axis, a, b, ends, kind, pose(sweep, t1))
            if s1 < TARGET - TOLERANCE:
                return ONE
            if s1 <= TARGET + TOLERANCE:
                return t1
            a1, a2 = t1, t2
            for i in range(ROOTS):
                t = a1 + (TARGET - s1) * (a2 - a1) / (s2 - s1) if i & 1 else HALF * (a1 + a2)
                s = _separation(axis, a, b, ends, kind, pose(sweep, t))
                if abs(s - TARGET) < TOLERANCE:
                    t2 = t
                    break
                if s > TARGET:
                    a1, s1 = t, s
                else:
                    a2, s2 = t, s
    return ONE
