"""The shapes of the lander and its legs as in Box2D 2.3: convex polygons of float32, and their masses.

Lengths are metres, angles radians, masses kilograms. The numbers are Gymnasium's (`LunarLander-v3`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

FPS, SCALE = 50, 30.0
WIDTH, HEIGHT = 600 / SCALE, 400 / SCALE
CHUNKS = 11
"""Number of points of the ground; between two neighbours lies an edge, and below all of them a level one."""
EDGES = CHUNKS
LEG_AWAY, LEG_DOWN = 20 / SCALE, 18 / SCALE
LEG_SIDES = (-1, 1)
BODIES = 3
"""The lander, its left leg and its right one."""


class Solid(NamedTuple):
    """A convex polygon and its mass."""

    vertices: Float32[np.ndarray, "vertices 2"]
    """Counterclockwise, around the origin of the body."""
    normals: Float32[np.ndarray, "vertices 2"]
    """Outwards, of the side that begins at the vertex."""
    centroid: Float32[np.ndarray, " 2"]
    center: Float32[np.ndarray, " 2"]
    """Centre of mass: the centroid, rounded in another way."""
    inverse_mass: np.float32
    inverse_inertia: np.float32
    """About the centre of mass."""
    friction: np.float32


def solid(
    vertices: Float32[np.ndarray, "vertices 2"], density: float, friction: float, *, is_box: bool
) -> Solid:
    """Compute the mass of a polygon by its triangles around the mean of its vertices, rounding as Box2D does."""
    one = np.float32(1)
    following = np.roll(vertices, -1, axis=0)
    side = following - vertices
    length = np.sqrt(side[:, 0] * side[:, 0] + side[:, 1] * side[:, 1])
    normals = np.stack([side[:, 1], -side[:, 0]], axis=1) * (one / length)[:, None]
    middle = np.zeros(2, np.float32)
    for vertex in vertices:
        middle += vertex
    middle *= one / np.float32(len(vertices))
    third = one / np.float32(3)
    center, area, inertia = np.zeros(2, np.float32), np.float32(0), np.float32(0)
    for a, b in zip(vertices - middle, following - middle, strict=True):
        cross = a[0] * b[1] - a[1] * b[0]
        triangle = np.float32(0.5) * cross
        area += triangle
        center += triangle * third * (a + b)
        squares = [a[i] * a[i] + b[i] * a[i] + b[i] * b[i] for i in (0, 1)]
        inertia += (np.float32(0.25) * third * cross) * (squares[0] + squares[1])
    mass = np.float32(density) * area
    center *= one / area
    whole = center + middle
    inertia = np.float32(density) * inertia
    inertia += mass * (_dot(whole, whole) - _dot(center, center))
    inverse_mass = one / mass
    held = (mass * whole) * inverse_mass
    inertia -= mass * _dot(held, held)
    centroid = np.zeros(2, np.float32) if is_box else _centroid(vertices)
    return Solid(vertices, normals, centroid, held, inverse_mass, one / inertia, np.float32(friction))


def _centroid(vertices: Float32[np.ndarray, "vertices 2"]) -> Float32[np.ndarray, " 2"]:
    """Return the centroid, by triangles from the origin."""
    third, area, center = np.float32(1) / np.float32(3), np.float32(0), np.zeros(2, np.float32)
    for a, b in zip(vertices, np.roll(vertices, -1, axis=0), strict=True):
        triangle = np.float32(0.5) * (a[0] * b[1] - a[1] * b[0])
        area += triangle
        center += triangle * third * (a + b)
    return center * (np.float32(1) / area)


def _dot(a: Float32[np.ndarray, " 2"], b: Float32[np.ndarray, " 2"]) -> np.float32:
    return a[0] * b[0] + a[1] * b[1]


def _points(*points: tuple[float, float]) -> Float32[np.ndarray, "vertices 2"]:
    return (np.array(points) / SCALE).astype(np.float32)


HULL = solid(
    _points((17, -10), (17, 0), (14, 17), (-14, 17), (-17, 0), (-17, -10)),
    density=5.0,
    friction=0.1,
    is_box=False,
)
LEG = solid(_points((-2, -8), (2, -8), (2, 8), (-2, 8)), density=1.0, friction=0.2, is_box=True)
