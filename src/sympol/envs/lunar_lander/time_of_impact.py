"""The time within a step at which a body reaches an edge: Box2D's conservative advancement over separating axes, to the
bit."""

from __future__ import annotations

import math

import numpy as np

from .bodies import CENTERS, NUMBER, VERTICES, rotated
from .collide import RADIUS
from .distance import EPSILON, at_corner, body_support, distance, edge_support
from .joints import SLOP
from .layout import HALF, ONE, ZERO, F
from .machine import compiled

TARGET = max(SLOP, RADIUS - F(3) * SLOP)
"""Distance of body and edge at the time of impact."""
TOLERANCE = F(0.25) * SLOP
TWO_PI = F(2) * F(3.14159265359)
AXES, PUSHES, ROOTS = 20, 16, 50
"""The most iterations: over separating axes, over deepest points along one, and of its root search."""
POINTS, EDGE_FACE, BODY_FACE = 0, 1, 2
"""Kinds of separating axes, by what makes them."""
NEAR = TARGET + F(2) * TOLERANCE
REACH = F(0.8)
"""The largest distance from the centre of mass to a corner."""


@compiled
def pose(sweep, beta):
    """Return origin and rotation at a part of a sweep, which is start, end and centre of mass."""
    cx0, cy0, angle0, cx, cy, angle, mx, my = sweep
    turn = (ONE - beta) * angle0 + beta * angle
    sin, cos = np.sin(turn), np.cos(turn)
    x, y = rotated(sin, cos, mx, my)
    return ((ONE - beta) * cx0 + beta * cx) - x, ((ONE - beta) * cy0 + beta * cy) - y, sin, cos


@compiled
def _unit(x, y):
    """Scale a direction to length one, unless it is zero."""
    length = np.sqrt(x * x + y * y)
    if length < EPSILON:
        return x, y
    part = ONE / length
    return x * part, y * part


@compiled
def _axis(simplex, index, count, ends, kind, at):
    """Return the separating axis: its kind, the axis in the frame of its face, and a point of that face."""
    px, py, sin, cos = at
    if count == 1:
        x, y = at_corner(kind, index[0, 1], at)
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
    x, y = at_corner(kind, index[0, 1], at)
    if (x - mx) * ax + (y - my) * ay < 0:
        ax, ay = -ax, -ay
    return EDGE_FACE, ax, ay, mx, my


@compiled
def _deepest(axis, ends, kind, at):
    """Return the end and the corner that are deepest along an axis."""
    face, ax, ay, _, _ = axis
    _, _, sin, cos = at
    if face == BODY_FACE:
        nx, ny = rotated(sin, cos, ax, ay)
        return edge_support(ends, -nx, -ny), 0
    b = body_support(kind, cos * -ax + sin * -ay, -sin * -ax + cos * -ay)
    return (edge_support(ends, ax, ay) if face == POINTS else 0), b


@compiled
def _separation(axis, a, b, ends, kind, at):
    """Return the separation of an end and a corner along an axis."""
    face, ax, ay, mx, my = axis
    px, py, sin, cos = at
    if face == BODY_FACE:
        nx, ny = rotated(sin, cos, ax, ay)
        x, y = (cos * mx - sin * my) + px, (sin * mx + cos * my) + py
        return (ends[a, 0] - x) * nx + (ends[a, 1] - y) * ny
    x, y = at_corner(kind, b, at)
    if face == POINTS:
        mx, my = ends[a, 0], ends[a, 1]
    return (x - mx) * ax + (y - my) * ay


@compiled
def _cannot_touch(edge, kind, sweep):
    """Return whether body and edge stay apart: all corners begin on one side, farther away than any of them moves."""
    cx0, cy0, angle0, cx, cy, angle, _, _ = sweep
    moves = abs(cx - cx0) + abs(cy - cy0) + REACH * abs(angle - angle0)
    at = pose(sweep, ZERO)
    low = high = ZERO
    for i in range(NUMBER[kind]):
        x, y = at_corner(kind, i, at)
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
    """Return the part of the sweep after which a body touches an edge; 1 where it does not, or did before."""
    turn = TWO_PI * F(math.floor(angle0 / TWO_PI))
    sweep = (cx0, cy0, angle0 - turn, cx, cy, angle - turn, CENTERS[kind, 0], CENTERS[kind, 1])
    if _cannot_touch(edge, kind, sweep):
        return ONE
    ends = np.empty((2, 2), np.float32)
    ends[0, 0], ends[0, 1], ends[1, 0], ends[1, 1] = edge.x1, edge.y1, edge.x2, edge.y2
    simplex, index = np.empty((4, 7), np.float32), np.zeros((4, 2), np.int64)
    count, metric, t1 = 0, ZERO, ZERO
    for _ in range(AXES):
        at = pose(sweep, t1)
        apart, count, metric = distance(simplex, index, count, metric, ends, kind, at)
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
