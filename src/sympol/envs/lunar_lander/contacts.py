"""Contacts of a leg with the ground as in Box2D, with friction and two points solved together, to the bit."""

from __future__ import annotations

import numpy as np

from .bodies import CENTERS, SKIN, clamp, placed, rotated
from .joints import IB, MB, SLOP
from .layout import HALF, ONE, POINTS, ZERO, F
from .machine import compiled, inlined

MOST_CORRECTION = F(0.2)
BAUMGARTE, TOI_BAUMGARTE = F(0.2), F(0.75)
CONDITION = F(1000)
"""The largest condition number with which two points are solved together; beyond it the second is left out."""


@compiled
def prepare_contact(contact, points, edge, leg):
    """Compute the constants of a contact while velocities are solved. The leg's transform fits its centre and angle."""
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


@inlined
def solve_contact(lanes, leg, contact, lane):
    """Solve a contact once: update the leg's velocities and the impulses of friction and of the ground.

    There are no branches: all lanes compute all cases, and each keeps its own.
    """
    solved, nx, ny = contact.solved[lane], contact.wx[lane], contact.wy[lane]
    tx, ty = ny, -nx
    vx, vy, w = lanes.vx[leg, lane], lanes.vy[leg, lane], lanes.spin[leg, lane]
    for i in range(POINTS):
        rx, ry, tangent = contact.rx[i, lane], contact.ry[i, lane], contact.tangent[i, lane]
        vt = (vx - w * ry) * tx + (vy + w * rx) * ty
        most = contact.friction[lane] * contact.normal[i, lane]
        now = clamp(tangent + contact.tangent_mass[i, lane] * -vt, -most, most)
        impulse = now - tangent
        px, py = impulse * tx, impulse * ty
        pushed = i < solved
        contact.tangent[i, lane] = now if pushed else tangent
        vx = vx + MB * px if pushed else vx
        vy = vy + MB * py if pushed else vy
        w = w + IB * (rx * py - ry * px) if pushed else w
    rx1, ry1, a1, mass1 = (
        contact.rx[0, lane],
        contact.ry[0, lane],
        contact.normal[0, lane],
        contact.normal_mass[0, lane],
    )
    rx2, ry2, a2, mass2 = (
        contact.rx[1, lane],
        contact.ry[1, lane],
        contact.normal[1, lane],
        contact.normal_mass[1, lane],
    )
    k11, k12, k22 = contact.k11[lane], contact.k12[lane], contact.k22[lane]
    v1 = (vx - w * ry1) * nx + (vy + w * rx1) * ny
    v2 = (vx - w * ry2) * nx + (vy + w * rx2) * ny
    # one point
    only = max(a1 + -mass1 * v1, ZERO)
    # two: both push, or the first, or the second, or none
    b1, b2 = v1 - (k11 * a1 + k12 * a2), v2 - (k12 * a1 + k22 * a2)
    both1 = -(contact.m11[lane] * b1 + contact.m12[lane] * b2)
    both2 = -(contact.m12[lane] * b1 + contact.m22[lane] * b2)
    both = (both1 >= ZERO) & (both2 >= ZERO)
    first, second = -mass1 * b1, -mass2 * b2
    one = (first >= ZERO) & (k12 * first + b2 >= ZERO)
    other = (second >= ZERO) & (k12 * second + b1 >= ZERO)
    none = (b1 >= ZERO) & (b2 >= ZERO)
    x1 = both1 if both else first if one else ZERO
    x2 = both2 if both else ZERO if one else second if other else ZERO
    found = both | one | other | none
    single = solved == 1
    x1 = only if single else x1 if found else a1
    x2 = a2 if single else x2 if found else a2
    d1, d2 = x1 - a1, x2 - a2
    p1x, p1y, p2x, p2y = d1 * nx, d1 * ny, d2 * nx, d2 * ny
    turn1, turn2 = rx1 * p1y - ry1 * p1x, rx2 * p2y - ry2 * p2x
    moved = single | (solved == 2) & found
    vx = vx + MB * (p1x if single else p1x + p2x) if moved else vx
    vy = vy + MB * (p1y if single else p1y + p2y) if moved else vy
    w = w + IB * (turn1 if single else turn1 + turn2) if moved else w
    contact.normal[0, lane] = x1 if moved else a1
    contact.normal[1, lane] = x2 if moved else a2
    lanes.vx[leg, lane], lanes.vy[leg, lane], lanes.spin[leg, lane] = vx, vy, w


@compiled
def contact_positions(contact, points, leg, baumgarte):
    """Move a leg out of the ground once; return how deep it was."""
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
