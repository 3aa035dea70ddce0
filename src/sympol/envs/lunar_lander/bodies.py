"""Positions of bodies: a moving centre of mass, an angle, and the corners of a shape around its origin."""

from __future__ import annotations

import numpy as np

from .layout import F
from .machine import compiled
from .shapes import HULL, LEG

SKIN = F(0.01)
"""Radius around every shape."""
FARTHEST = F(3.4e38)
_CORNERS = 6
VERTICES = np.zeros((2, _CORNERS, 2), np.float32)
NORMALS = np.zeros((2, _CORNERS, 2), np.float32)
for _i, _solid in enumerate((HULL, LEG)):
    VERTICES[_i, : len(_solid.vertices)] = _solid.vertices
    NORMALS[_i, : len(_solid.normals)] = _solid.normals
NUMBER = np.array([len(HULL.vertices), len(LEG.vertices)])
CENTROIDS = np.stack([HULL.centroid, LEG.centroid])
CENTERS = np.stack([HULL.center, LEG.center])


@compiled
def kind_of(body):
    """Return the kind of a body: 0 for the lander, 1 for a leg."""
    return 0 if body == 0 else 1


@compiled
def rotated(sin, cos, x, y):
    """Rotate a direction from the body's frame into the world's."""
    return cos * x - sin * y, sin * x + cos * y


@compiled
def placed(body, x, y):
    """Transform a point from the body's frame into the world's."""
    return (body.cos * x - body.sin * y) + body.px, (body.sin * x + body.cos * y) + body.py


@compiled
def corner(body, kind, i):
    """Return the position of the i-th corner."""
    return placed(body, VERTICES[kind, i, 0], VERTICES[kind, i, 1])


@compiled
def transform(body, kind_x, kind_y):
    """Compute origin and rotation from centre of mass and angle."""
    body.sin, body.cos = np.sin(body.angle), np.cos(body.angle)
    x, y = rotated(body.sin, body.cos, kind_x, kind_y)
    body.px, body.py = body.cx - x, body.cy - y


@compiled
def integrate(body, dt):
    """Move a body by its velocity."""
    body.cx += dt * body.vx
    body.cy += dt * body.vy
    body.angle += dt * body.spin


@compiled
def clamp(x, low, high):
    """Clip a number to two bounds."""
    return max(low, min(x, high))
