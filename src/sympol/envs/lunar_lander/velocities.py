"""Velocities that joints and contacts allow: Box2D's sequential impulses, to the bit, for several landings at a time.

Box2D solves 180 times over, as Gymnasium asks, and each time goes on from the last: a processor that did it for one
landing would mostly wait. Here it does the same to `LANES` landings at once, which is most of why this is fast.
"""

from __future__ import annotations

import numpy as np

from .contacts import solve_contact
from .joints import solve_joint
from .layout import LANES, POINTS
from .machine import compiled

ITERATIONS = 180


@compiled
def solve_velocities(landings, which, room):
    """Of some landings, at most `LANES`; ``which`` are their numbers."""
    hinged, standing = room.hinged[0], room.standing
    _nothing_stands(standing)
    most = np.zeros(2, np.int64)
    for lane in range(len(which)):
        bodies, joints, contacts, points = _parts(landings, which[lane])
        _take_bodies(hinged, lane, bodies, joints)
        for leg in range(2):
            b = leg + 1
            number = _take_touching(standing[leg], lane, contacts[b], points[b], range(bodies[b].contacts))
            most[leg] = max(most[leg], number)
    for _ in range(ITERATIONS):
        _solve_joints(hinged)
        for leg in (1, 0):
            for k in range(most[leg]):
                _solve_contacts(hinged, leg + 1, standing[leg, k])
    for lane in range(len(which)):
        bodies, joints, contacts, points = _parts(landings, which[lane])
        _give_bodies(hinged, lane, bodies, joints)
        for leg in range(2):
            number = 0
            for k in range(bodies[leg + 1].contacts):
                if contacts[leg + 1, k].touching:
                    _give_contact(standing[leg, number], lane, points[leg + 1, k])
                    number += 1


@compiled
def solve_alone(leg, contacts, points, order, room):
    """Of a leg without what it hangs on; its contacts in this order. Their impulses stay what they are."""
    hinged, standing = room.hinged[0], room.standing
    _nothing_stands(standing)
    hinged.vx[1, 0], hinged.vy[1, 0], hinged.spin[1, 0] = leg.vx, leg.vy, leg.spin
    number = _take_touching(standing[0], 0, contacts, points, order)
    for _ in range(ITERATIONS):
        for k in range(number):
            _solve_contacts(hinged, 1, standing[0, k])
    leg.vx, leg.vy, leg.spin = hinged.vx[1, 0], hinged.vy[1, 0], hinged.spin[1, 0]


@compiled
def _parts(landings, at):
    return landings.bodies[at], landings.joints[at], landings.contacts[at], landings.points[at]


@compiled
def _nothing_stands(standing):
    for leg in range(len(standing)):
        for k in range(standing.shape[1]):
            for lane in range(LANES):
                standing[leg, k].solved[lane] = 0


@compiled
def _solve_joints(hinged):
    """Once, in all lanes: the right leg's first."""
    for lane in range(LANES):
        ax, ay, aw = hinged.vx[0, lane], hinged.vy[0, lane], hinged.spin[0, lane]
        bx, by, bw = hinged.vx[2, lane], hinged.vy[2, lane], hinged.spin[2, lane]
        ax, ay, aw, bx, by, bw = solve_joint(hinged, 1, lane, ax, ay, aw, bx, by, bw)
        hinged.vx[2, lane], hinged.vy[2, lane], hinged.spin[2, lane] = bx, by, bw
        bx, by, bw = hinged.vx[1, lane], hinged.vy[1, lane], hinged.spin[1, lane]
        ax, ay, aw, bx, by, bw = solve_joint(hinged, 0, lane, ax, ay, aw, bx, by, bw)
        hinged.vx[1, lane], hinged.vy[1, lane], hinged.spin[1, lane] = bx, by, bw
        hinged.vx[0, lane], hinged.vy[0, lane], hinged.spin[0, lane] = ax, ay, aw


@compiled
def _solve_contacts(hinged, leg, contact):
    """Once, in all lanes."""
    for lane in range(LANES):
        solve_contact(hinged, leg, contact, lane)


@compiled
def _take_bodies(hinged, lane, bodies, joints):
    for b in range(3):
        hinged.vx[b, lane], hinged.vy[b, lane], hinged.spin[b, lane] = (
            bodies[b].vx,
            bodies[b].vy,
            bodies[b].spin,
        )
    for j in range(2):
        joint = joints[j]
        hinged.ix[j, lane], hinged.iy[j, lane], hinged.iz[j, lane] = joint.ix, joint.iy, joint.iz
        hinged.motor[j, lane], hinged.limit[j, lane] = joint.motor, joint.limit
        hinged.ax[j, lane], hinged.ay[j, lane] = joint.ax, joint.ay
        hinged.bx[j, lane], hinged.by[j, lane] = joint.bx, joint.by
        hinged.kxx[j, lane], hinged.kxy[j, lane], hinged.kxz[j, lane] = joint.kxx, joint.kxy, joint.kxz
        hinged.kyy[j, lane], hinged.kyz[j, lane], hinged.kzz[j, lane] = joint.kyy, joint.kyz, joint.kzz
        hinged.det3[j, lane], hinged.det2[j, lane] = joint.det3, joint.det2


@compiled
def _give_bodies(hinged, lane, bodies, joints):
    for b in range(3):
        bodies[b].vx, bodies[b].vy, bodies[b].spin = (
            hinged.vx[b, lane],
            hinged.vy[b, lane],
            hinged.spin[b, lane],
        )
    for j in range(2):
        joint = joints[j]
        joint.ix, joint.iy, joint.iz = hinged.ix[j, lane], hinged.iy[j, lane], hinged.iz[j, lane]
        joint.motor = hinged.motor[j, lane]


@compiled
def _take_touching(standing, lane, contacts, points, order):
    """Those of a leg's contacts that touch, in this order; how many there are."""
    number = 0
    for k in order:
        if contacts[k].touching:
            _take_contact(standing[number], lane, contacts[k], points[k])
            number += 1
    return number


@compiled
def _take_contact(standing, lane, contact, points):
    standing.solved[lane], standing.friction[lane] = contact.solved, contact.friction
    standing.wx[lane], standing.wy[lane] = contact.wx, contact.wy
    standing.k11[lane], standing.k12[lane], standing.k22[lane] = contact.k11, contact.k12, contact.k22
    standing.m11[lane], standing.m12[lane], standing.m22[lane] = contact.m11, contact.m12, contact.m22
    for i in range(POINTS):
        point = points[i]
        standing.normal[i, lane], standing.tangent[i, lane] = point.normal, point.tangent
        standing.rx[i, lane], standing.ry[i, lane] = point.rx, point.ry
        standing.normal_mass[i, lane], standing.tangent_mass[i, lane] = point.normal_mass, point.tangent_mass


@compiled
def _give_contact(standing, lane, points):
    for i in range(POINTS):
        points[i].normal, points[i].tangent = standing.normal[i, lane], standing.tangent[i, lane]
