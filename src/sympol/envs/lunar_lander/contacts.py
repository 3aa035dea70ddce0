"""What the ground does to a leg: Box2D's contacts, with friction and two points solved as one, to the bit."""

from __future__ import annotations

import numpy as np

from .bodies import CENTERS, SKIN, clamp, placed, rotated
from .joints import IB, MB, SLOP
from .layout import HALF, ONE, ZERO, F
from .machine import compiled

MOST_CORRECTION = F(0.2)
BAUMGARTE, TOI_BAUMGARTE = F(0.2), F(0.75)
CONDITION = F(1000)
"""Two points that are nearer to being one than this are solved as one."""


@compiled
def prepare_contact(contact, points, edge, leg):
    """What stays as it is while velocities are solved. The leg's transform is that of its centre and angle."""
    contact.solved, contact.friction = contact.points, edge.friction
    if contact.of_edge:
        nx, ny, px, py = contact.nx, contact.ny, contact.px, contact.py
    else:
        nx, ny = rotated(leg.sin, leg.cos, contact.nx, contact.ny)
        px, py = placed(leg, contact.px, contact.py)
    wx, wy = (nx, ny) if contact.of_edge else (-nx, -ny)
    contact.wx, contact.wy = wx, wy
    tx, ty = wy, -wx
    for i in range(contact.points):
        point = points[i]
        x, y = placed(leg, point.x, point.y) if contact.of_edge else (point.x, point.y)
        far = SKIN - ((x - px) * nx + (y - py) * ny)
        x0, y0 = x + far * nx, y + far * ny
        x1, y1 = x - SKIN * nx, y - SKIN * ny
        x, y = HALF * (x0 + x1), HALF * (y0 + y1)
        rx, ry = x - leg.cx, y - leg.cy
        point.rx, point.ry = rx, ry
        rn, rt = rx * wy - ry * wx, rx * ty - ry * tx
        point.normal_mass = ONE / (MB + IB * rn * rn)
        point.tangent_mass = ONE / (MB + IB * rt * rt)
    if contact.points == 2:
        p, q = points[0], points[1]
        r1, r2 = p.rx * wy - p.ry * wx, q.rx * wy - q.ry * wx
        k11, k22, k12 = MB + IB * r1 * r1, MB + IB * r2 * r2, MB + IB * r1 * r2
        if k11 * k11 < CONDITION * (k11 * k22 - k12 * k12):
            det = k11 * k22 - k12 * k12
            if det != ZERO:
                det = ONE / det
            contact.k11, contact.k12, contact.k22 = k11, k12, k22
            contact.m11, contact.m12, contact.m22 = det * k22, -det * k12, det * k11
        else:
            contact.solved = 1


@compiled
def warm_start(contact, points, leg):
    """Apply the impulses of the last step."""
    tx, ty = contact.wy, -contact.wx
    for i in range(contact.solved):
        point = points[i]
        px = point.normal * contact.wx + point.tangent * tx
        py = point.normal * contact.wy + point.tangent * ty
        leg.spin += IB * (point.rx * py - point.ry * px)
        leg.vx += MB * px
        leg.vy += MB * py


@compiled
def solve_contact(contact, points, vx, vy, w):
    """Once: velocities of a leg after friction and what it stands on have had their say; whether impulses changed."""
    nx, ny = contact.wx, contact.wy
    tx, ty = ny, -nx
    changed = False
    for i in range(contact.solved):
        point = points[i]
        vt = (vx - w * point.ry) * tx + (vy + w * point.rx) * ty
        most = contact.friction * point.normal
        now = clamp(point.tangent + point.tangent_mass * -vt, -most, most)
        impulse = now - point.tangent
        changed = changed or now != point.tangent
        point.tangent = now
        px, py = impulse * tx, impulse * ty
        vx += MB * px
        vy += MB * py
        w += IB * (point.rx * py - point.ry * px)
    p, q = points[0], points[1]
    if contact.solved == 1:
        vn = (vx - w * p.ry) * nx + (vy + w * p.rx) * ny
        now = max(p.normal + -p.normal_mass * vn, ZERO)
        impulse = now - p.normal
        changed = changed or now != p.normal
        p.normal = now
        px, py = impulse * nx, impulse * ny
        vx += MB * px
        vy += MB * py
        w += IB * (p.rx * py - p.ry * px)
        return vx, vy, w, changed
    a1, a2 = p.normal, q.normal
    b1 = (vx - w * p.ry) * nx + (vy + w * p.rx) * ny
    b2 = (vx - w * q.ry) * nx + (vy + w * q.rx) * ny
    b1 -= contact.k11 * a1 + contact.k12 * a2
    b2 -= contact.k12 * a1 + contact.k22 * a2
    x1, x2 = -(contact.m11 * b1 + contact.m12 * b2), -(contact.m12 * b1 + contact.m22 * b2)
    if not (x1 >= ZERO and x2 >= ZERO):
        x1, x2 = -p.normal_mass * b1, ZERO
        if not (x1 >= ZERO and contact.k12 * x1 + b2 >= ZERO):
            x1, x2 = ZERO, -q.normal_mass * b2
            if not (x2 >= ZERO and contact.k12 * x2 + b1 >= ZERO):
                x1, x2 = ZERO, ZERO
                if not (b1 >= ZERO and b2 >= ZERO):
                    return vx, vy, w, changed
    d1, d2 = x1 - a1, x2 - a2
    p1x, p1y, p2x, p2y = d1 * nx, d1 * ny, d2 * nx, d2 * ny
    vx += MB * (p1x + p2x)
    vy += MB * (p1y + p2y)
    w += IB * ((p.rx * p1y - p.ry * p1x) + (q.rx * p2y - q.ry * p2x))
    changed = changed or x1 != a1 or x2 != a2
    p.normal, q.normal = x1, x2
    return vx, vy, w, changed


@compiled
def contact_positions(contact, points, leg, baumgarte):
    """Once: move a leg out of the ground; how deep it was."""
    deepest = ZERO
    for i in range(contact.points):
        point = points[i]
        sin, cos = np.sin(leg.angle), np.cos(leg.angle)
        cx, cy = rotated(sin, cos, CENTERS[1, 0], CENTERS[1, 1])
        px, py = leg.cx - cx, leg.cy - cy
        if contact.of_edge:
            nx, ny = contact.nx, contact.ny
            x, y = (cos * point.x - sin * point.y) + px, (sin * point.x + cos * point.y) + py
            separation = (x - contact.px) * nx + (y - contact.py) * ny - SKIN - SKIN
        else:
            nx, ny = rotated(sin, cos, contact.nx, contact.ny)
            fx, fy = (cos * contact.px - sin * contact.py) + px, (sin * contact.px + cos * contact.py) + py
            x, y = point.x, point.y
            separation = (x - fx) * nx + (y - fy) * ny - SKIN - SKIN
            nx, ny = -nx, -ny
        rx, ry = x - leg.cx, y - leg.cy
        deepest = min(deepest, separation)
        c = clamp(baumgarte * (separation + SLOP), -MOST_CORRECTION, ZERO)
        rn = rx * ny - ry * nx
        k = MB + IB * rn * rn
        impulse = -c / k if k > ZERO else ZERO
        px, py = impulse * nx, impulse * ny
        leg.cx += MB * px
        leg.cy += MB * py
        leg.angle += IB * (rx * py - ry * px)
    return deepest
