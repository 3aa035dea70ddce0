"""Points where a body touches an edge of the ground: the one or two of Box2D's manifold, to the bit.

The ground does not move, so that an edge's frame is the world's.
"""

from __future__ import annotations

from .bodies import CENTROIDS, FARTHEST, NORMALS, NUMBER, SKIN, VERTICES, corner, kind_of, placed, rotated
from .broadphase import boxes_overlap
from .layout import CONTACTS, ONE, ZERO, F
from .machine import compiled

RADIUS = F(2) * SKIN
RELATIVE, ABSOLUTE = F(0.98), F(0.001)
"""A side of the body is taken as the face only if it is better than the edge by this factor and offset."""


@compiled
def _cut(x0, y0, f0, x1, y1, f1, nx, ny, offset, index):
    """Cut a segment at a line; return the number of points left, and the points."""
    d0 = (nx * x0 + ny * y0) - offset
    d1 = (nx * x1 + ny * y1) - offset
    if d0 <= ZERO and d1 <= ZERO:
        return 2, x0, y0, f0, x1, y1, f1
    if d0 * d1 < ZERO:
        part = d0 / (d0 - d1)
        x, y = x0 + part * (x1 - x0), y0 + part * (y1 - y0)
        # the cut is a corner of what is the face, on the side where the first point was
        feature = feature_of(index, f0 >> 8 & 255, 0, 1)
        if d0 <= ZERO:
            return 2, x0, y0, f0, x, y, feature
        return 2, x1, y1, f1, x, y, feature
    return 0, x0, y0, f0, x1, y1, f1


@compiled
def feature_of(index_a, index_b, face_a, face_b):
    """Return the corner and side that make a point, as one number."""
    return index_a | index_b << 8 | face_a << 16 | face_b << 17


@compiled
def manifold(edge, body, kind, contact, points):
    """Find the points where a body touches an edge, and store them; return their number."""
    mx, my = placed(body, CENTROIDS[kind, 0], CENTROIDS[kind, 1])
    front = edge.nx * (mx - edge.x1) + edge.ny * (my - edge.y1) >= 0
    nx, ny = (edge.nx, edge.ny) if front else (-edge.nx, -edge.ny)
    number = NUMBER[kind]
    apart = FARTHEST
    for i in range(number):
        x, y = corner(body, kind, i)
        s = nx * (x - edge.x1) + ny * (y - edge.y1)
        if s < apart:
            apart = s
    if apart > RADIUS:
        return 0
    side, best = 0, -FARTHEST
    for i in range(number):
        x, y = corner(body, kind, i)
        bx, by = rotated(body.sin, body.cos, NORMALS[kind, i, 0], NORMALS[kind, i, 1])
        bx, by = -bx, -by
        s1 = bx * (x - edge.x1) + by * (y - edge.y1)
        s2 = bx * (x - edge.x2) + by * (y - edge.y2)
        s = s1 if s1 < s2 else s2
        if s > RADIUS:
            return 0
        if s > best:
            side, best = i, s
    of_edge = not best > RELATIVE * apart + ABSOLUTE
    if of_edge:
        lowest, least = 0, FARTHEST
        for i in range(number):
            bx, by = rotated(body.sin, body.cos, NORMALS[kind, i, 0], NORMALS[kind, i, 1])
            value = nx * bx + ny * by
            if value < least:
                lowest, least = i, value
        j = lowest + 1 if lowest + 1 < number else 0
        x0, y0 = corner(body, kind, lowest)
        x1, y1 = corner(body, kind, j)
        f0, f1 = feature_of(0, lowest, 1, 0), feature_of(0, j, 1, 0)
        fx, fy = nx, ny
        if front:
            i1, i2, ax, ay, bx, by = 0, 1, edge.x1, edge.y1, edge.x2, edge.y2
        else:
            i1, i2, ax, ay, bx, by = 1, 0, edge.x2, edge.y2, edge.x1, edge.y1
    else:
        x0, y0, x1, y1 = edge.x1, edge.y1, edge.x2, edge.y2
        f0 = f1 = feature_of(0, side, 0, 1)
        i1 = side
        i2 = side + 1 if side + 1 < number else 0
        ax, ay = corner(body, kind, i1)
        bx, by = corner(body, kind, i2)
        fx, fy = rotated(body.sin, body.cos, NORMALS[kind, side, 0], NORMALS[kind, side, 1])
    sx, sy = fy, -fx
    left, x0, y0, f0, x1, y1, f1 = _cut(x0, y0, f0, x1, y1, f1, sx, sy, sx * ax + sy * ay, i1)
    if left < 2:
        return 0
    left, x0, y0, f0, x1, y1, f1 = _cut(x0, y0, f0, x1, y1, f1, -sx, -sy, -sx * bx + -sy * by, i2)
    if left < 2:
        return 0
    contact.of_edge = int(of_edge)
    if of_edge:
        contact.nx, contact.ny, contact.px, contact.py = fx, fy, ax, ay
    else:
        contact.nx, contact.ny = NORMALS[kind, side, 0], NORMALS[kind, side, 1]
        contact.px, contact.py = VERTICES[kind, side, 0], VERTICES[kind, side, 1]
    found = 0
    for i in range(2):
        x, y, feature = (x0, y0, f0) if i == 0 else (x1, y1, f1)
        if fx * (x - ax) + fy * (y - ay) <= RADIUS:
            point = points[found]
            if of_edge:
                dx, dy = x - body.px, y - body.py
                x, y = body.cos * dx + body.sin * dy, -body.sin * dx + body.cos * dy
            else:
                feature = feature_of(feature >> 8 & 255, feature & 255, feature >> 17 & 1, feature >> 16 & 1)
            point.x, point.y, point.feature = x, y, feature
            found += 1
    return found


@compiled
def update_contact(landing, b, k):
    """Update a contact, keeping impulses at points that were there. Return 1 where it begins, -1 where it ends, else
    0."""
    contact, points = landing.contacts[b, k], landing.points[b, k]
    old = contact.points
    f0, n0, t0 = points[0].feature, points[0].normal, points[0].tangent
    f1, n1, t1 = points[1].feature, points[1].normal, points[1].tangent
    contact.enabled = 1
    found = manifold(landing.edges[contact.edge], landing.bodies[b], kind_of(b), contact, points)
    contact.points = found
    for i in range(found):
        point = points[i]
        if old > 0 and point.feature == f0:
            point.normal, point.tangent = n0, t0
        elif old > 1 and point.feature == f1:
            point.normal, point.tangent = n1, t1
        else:
            point.normal, point.tangent = F(0), F(0)
    before, contact.touching = contact.touching, int(found > 0)
    if contact.touching == before:
        return 0
    return 1 if contact.touching else -1


@compiled
def report_contact(landing, b, change):
    """Tell the game of a contact that begins or ends; as in Gymnasium, it forgets that a leg may stand on two edges."""
    game = landing.game[0]
    if change == 0:
        return
    if b == 0:
        if change > 0:
            game.crashed = 1
    elif b == 1:
        game.left = int(change > 0)
    else:
        game.right = int(change > 0)


@compiled
def add_contacts(landing, b):
    """Add contacts with edges that a body has come near to, the newest first."""
    body = landing.bodies[b]
    for e in range(len(landing.edges)):
        if not boxes_overlap(body, landing.edges[e]):
            continue
        known = False
        for k in range(body.contacts):
            known = known or landing.contacts[b, k].edge == e
        if known or body.contacts == CONTACTS:
            continue
        for k in range(body.contacts, 0, -1):
            landing.contacts[b, k] = landing.contacts[b, k - 1]
            landing.points[b, k, 0] = landing.points[b, k - 1, 0]
            landing.points[b, k, 1] = landing.points[b, k - 1, 1]
        contact = landing.contacts[b, 0]
        contact.edge, contact.touching, contact.points, contact.enabled = e, 0, 0, 1
        contact.toi, contact.has_toi, contact.substeps = ONE, 0, 0
        body.contacts += 1


@compiled
def update_contacts(landing, b):
    """Update a body's contacts, and remove those whose boxes are apart."""
    body = landing.bodies[b]
    k = 0
    while k < body.contacts:
        if boxes_overlap(body, landing.edges[landing.contacts[b, k].edge]):
            report_contact(landing, b, update_contact(landing, b, k))
            k += 1
            continue
        if landing.contacts[b, k].touching:
            report_contact(landing, b, -1)
        for i in range(k + 1, body.contacts):
            landing.contacts[b, i - 1] = landing.contacts[b, i]
            landing.points[b, i - 1, 0] = landing.points[b, i, 0]
            landing.points[b, i - 1, 1] = landing.points[b, i, 1]
        body.contacts -= 1
