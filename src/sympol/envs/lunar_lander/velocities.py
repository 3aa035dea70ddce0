"""Velocities that joints and contacts allow: Box2D's sequential impulses, to the bit, for several landings at a time.

Box2D does 180 iterations, as Gymnasium sets it, each of which depends on the last: a processor that did it for one
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
def solve_velocities(landings, which, lanes):
    """Solve the velocities of some landings, at most `LANES`; ``which`` are their numbers."""
    joint_lanes, contact_lanes = lanes.joints[0], lanes.contacts
    _clear_contacts(contact_lanes)
    most = np.zeros(2, np.int64)
    for lane in range(len(which)):
        bodies, joints, contacts, points = _parts(landings, which[lane])
        _load_bodies(joint_lanes, lane, bodies, joints)
        for leg in range(2):
            b = leg + 1
            number = _load_touching(
                contact_lanes[leg], lane, contacts[b], points[b], range(bodies[b].contacts)
            )
            most[leg] = max(most[leg], number)
    for _ in range(ITERATIONS):
        _solve_joints(joint_lanes)
        for leg in (1, 0):
            for k in range(most[leg]):
                _solve_contacts(joint_lanes, leg + 1, contact_lanes[leg, k])
    for lane in range(len(which)):
        bodies, joints, contacts, points = _parts(landings, which[lane])
        _store_bodies(joint_lanes, lane, bodies, joints)
        for leg in range(2):
            number = 0
            for k in range(bodies[leg + 1].contacts):
                if contacts[leg + 1, k].touching:
                    _store_contact(contact_lanes[leg, number], lane, points[leg + 1, k])
                    number += 1


@compiled
def solve_alone(leg, contacts, points, order, lanes):
    """Solve the velocities of a leg without its joint, its contacts in this order; their impulses are not stored."""
    joint_lanes, contact_lanes = lanes.joints[0], lanes.contacts
    _clear_contacts(contact_lanes)
    joint_lanes.vx[1, 0], joint_lanes.vy[1, 0], joint_lanes.spin[1, 0] = leg.vx, leg.vy, leg.spin
    number = _load_touching(contact_lanes[0], 0, contacts, points, order)
    for _ in range(ITERATIONS):
        for k in range(number):
            _solve_contacts(joint_lanes, 1, contact_lanes[0, k])
    leg.vx, leg.vy, leg.spin = joint_lanes.vx[1, 0], joint_lanes.vy[1, 0], joint_lanes.spin[1, 0]


@compiled
def _parts(landings, at):
    return landings.bodies[at], landings.joints[at], landings.contacts[at], landings.points[at]


@compiled
def _clear_contacts(lanes):
    for leg in range(len(lanes)):
        for k in range(lanes.shape[1]):
            for lane in range(LANES):
                lanes[leg, k].solved[lane] = 0


@compiled
def _solve_joints(lanes):
    """Solve the joints once in all lanes, the right leg's first."""
    for lane in range(LANES):
        ax, ay, aw = lanes.vx[0, lane], lanes.vy[0, lane], lanes.spin[0, lane]
        bx, by, bw = lanes.vx[2, lane], lanes.vy[2, lane], lanes.spin[2, lane]
        ax, ay, aw, bx, by, bw = solve_joint(lanes, 1, lane, ax, ay, aw, bx, by, bw)
        lanes.vx[2, lane], lanes.vy[2, lane], lanes.spin[2, lane] = bx, by, bw
        bx, by, bw = lanes.vx[1, lane], lanes.vy[1, lane], lanes.spin[1, lane]
        ax, ay, aw, bx, by, bw = solve_joint(lanes, 0, lane, ax, ay, aw, bx, by, bw)
        lanes.vx[1, lane], lanes.vy[1, lane], lanes.spin[1, lane] = bx, by, bw
        lanes.vx[0, lane], lanes.vy[0, lane], lanes.spin[0, lane] = ax, ay, aw


@compiled
def _solve_contacts(lanes, leg, contact):
    """Solve a contact once in all lanes."""
    for lane in range(LANES):
        solve_contact(lanes, leg, contact, lane)


@compiled
def _load_bodies(lanes, lane, bodies, joints):
    for b in range(3):
        lanes.vx[b, lane], lanes.vy[b, lane], lanes.spin[b, lane] = bodies[b].vx, bodies[b].vy, bodies[b].spin
    for j in range(2):
        joint = joints[j]
        lanes.ix[j, lane], lanes.iy[j, lane], lanes.iz[j, lane] = joint.ix, joint.iy, joint.iz
        lanes.motor[j, lane], lanes.limit[j, lane] = joint.motor, joint.limit
        lanes.ax[j, lane], lanes.ay[j, lane] = joint.ax, joint.ay
        lanes.bx[j, lane], lanes.by[j, lane] = joint.bx, joint.by
        lanes.kxx[j, lane], lanes.kxy[j, lane], lanes.kxz[j, lane] = joint.kxx, joint.kxy, joint.kxz
        lanes.kyy[j, lane], lanes.kyz[j, lane], lanes.kzz[j, lane] = joint.kyy, joint.kyz, joint.kzz
        lanes.det3[j, lane], lanes.det2[j, lane] = joint.det3, joint.det2


@compiled
def _store_bodies(lanes, lane, bodies, joints):
    for b in range(3):
        bodies[b].vx, bodies[b].vy, bodies[b].spin = lanes.vx[b, lane], lanes.vy[b, lane], lanes.spin[b, lane]
    for j in range(2):
        joint = joints[j]
        joint.ix, joint.iy, joint.iz = lanes.ix[j, lane], lanes.iy[j, lane], lanes.iz[j, lane]
        joint.motor = lanes.motor[j, lane]


@compiled
def _load_touching(lanes, lane, contacts, points, order):
    """Load those of a leg's contacts that touch, in this order; return their number."""
    number = 0
    for k in order:
        if contacts[k].touching:
            _load_contact(lanes[number], lane, contacts[k], points[k])
            number += 1
    return number


@compiled
def _load_contact(lanes, lane, contact, points):
    lanes.solved[lane], lanes.friction[lane] = contact.solved, contact.friction
    lanes.wx[lane], lanes.wy[lane] = contact.wx, contact.wy
    lanes.k11[lane], lanes.k12[lane], lanes.k22[lane] = contact.k11, contact.k12, contact.k22
    lanes.m11[lane], lanes.m12[lane], lanes.m22[lane] = contact.m11, contact.m12, contact.m22
    for i in range(POINTS):
        point = points[i]
        lanes.normal[i, lane], lanes.tangent[i, lane] = point.normal, point.tangent
        lanes.rx[i, lane], lanes.ry[i, lane] = point.rx, point.ry
        lanes.normal_mass[i, lane], lanes.tangent_mass[i, lane] = point.normal_mass, point.tangent_mass


@compiled
def _store_contact(lanes, lane, points):
    for i in range(POINTS):
        points[i].normal, points[i].tangent = lanes.normal[i, lane], lanes.tangent[i, lane]
