"""The hinges that hold the legs, with their motors and limits: Box2D's revolute joints, to the bit."""

from __future__ import annotations

import numpy as np

from .bodies import clamp, rotated
from .layout import ONE, ZERO, F
from .machine import compiled, inlined
from .shapes import FPS, HULL, LEG, LEG_AWAY, LEG_DOWN, LEG_SIDES

DT = F(1 / FPS)
MA, MB, IA, IB = HULL.inverse_mass, LEG.inverse_mass, HULL.inverse_inertia, LEG.inverse_inertia
ANCHOR_A = (ZERO - HULL.center[0], ZERO - HULL.center[1])
"""Positions of the joints, from the lander's centre of mass."""
ANCHOR_B = np.array([[F(side * LEG_AWAY), F(LEG_DOWN)] for side in LEG_SIDES], np.float32) - LEG.center
SPEED = np.array([0.3 * side for side in LEG_SIDES], np.float32)
"""Speeds of the motors that push the legs out."""
MOST_TORQUE = DT * F(40)
LOWER, UPPER = np.array([0.9 - 0.5, -0.9], np.float32), np.array([0.9, -0.9 + 0.5], np.float32)
MOTOR_MASS = ONE / (IA + IB)
REFERENCE = np.array([0.05 * side for side in LEG_SIDES], np.float32)
"""Angles between legs and lander at the beginning, from which others are counted."""
SLOP, ANGULAR_SLOP = F(0.005), F(2) / F(180) * F(3.14159265359)
MOST_ANGULAR_CORRECTION = F(8) / F(180) * F(3.14159265359)


@compiled
def prepare_joint(joint, j, lander, leg):
    """Compute the constants of a joint while velocities are solved, and apply the last step's impulses."""
    ax, ay = rotated(np.sin(lander.angle), np.cos(lander.angle), ANCHOR_A[0], ANCHOR_A[1])
    bx, by = rotated(np.sin(leg.angle), np.cos(leg.angle), ANCHOR_B[j, 0], ANCHOR_B[j, 1])
    joint.ax, joint.ay, joint.bx, joint.by = ax, ay, bx, by
    exx = MA + MB + ay * ay * IA + by * by * IB
    eyx = -ay * ax * IA - by * bx * IB
    ezx = -ay * IA - by * IB
    eyy = MA + MB + ax * ax * IA + bx * bx * IB
    ezy = ax * IA + bx * IB
    ezz = IA + IB
    joint.kxx, joint.kxy, joint.kxz, joint.kyy, joint.kyz, joint.kzz = exx, eyx, ezx, eyy, ezy, ezz
    cx, cy, cz = eyy * ezz - ezy * ezy, ezy * ezx - eyx * ezz, eyx * ezy - eyy * ezx
    det3 = exx * cx + eyx * cy + ezx * cz
    joint.det3 = ONE / det3 if det3 != ZERO else det3
    det2 = exx * eyy - eyx * eyx
    joint.det2 = ONE / det2 if det2 != ZERO else det2
    angle = leg.angle - lander.angle - REFERENCE[j]
    limit = -1 if angle <= LOWER[j] else 1 if angle >= UPPER[j] else 0
    if limit == 0 or limit != joint.limit:
        joint.iz = ZERO
    joint.limit = limit
    turn = joint.motor
    lander.vx -= MA * joint.ix
    lander.vy -= MA * joint.iy
    lander.spin -= IA * ((ax * joint.iy - ay * joint.ix) + turn + joint.iz)
    leg.vx += MB * joint.ix
    leg.vy += MB * joint.iy
    leg.spin += IB * ((bx * joint.iy - by * joint.ix) + turn + joint.iz)


@inlined
def solve_joint(lanes, j, lane, ax, ay, aw, bx, by, bw):
    """Solve a joint once: return the velocities of the lander and of a leg after motor, limit and hinge.

    There are no branches: all lanes compute all cases, and each keeps its own.
    """
    kxx, kxy, kyy = lanes.kxx[j, lane], lanes.kxy[j, lane], lanes.kyy[j, lane]
    kxz, kyz, kzz = lanes.kxz[j, lane], lanes.kyz[j, lane], lanes.kzz[j, lane]
    arm_ax, arm_ay, arm_bx, arm_by = (
        lanes.ax[j, lane],
        lanes.ay[j, lane],
        lanes.bx[j, lane],
        lanes.by[j, lane],
    )
    det2, det3, limit = lanes.det2[j, lane], lanes.det3[j, lane], lanes.limit[j, lane]
    iz, motor = lanes.iz[j, lane], lanes.motor[j, lane]
    now = clamp(motor + -MOTOR_MASS * (bw - aw - SPEED[j]), -MOST_TORQUE, MOST_TORQUE)
    impulse = now - motor
    aw -= IA * impulse
    bw += IB * impulse
    dx = bx - bw * arm_by - ax + aw * arm_ay
    dy = by + bw * arm_bx - ay - aw * arm_ax
    dz = bw - aw
    # with the hinge alone
    hinge_x = det2 * (kyy * -dx - kxy * -dy)
    hinge_y = det2 * (kxx * -dy - kxy * -dx)
    # with hinge and limit
    cx, cy, cz = kyy * kzz - kyz * kyz, kyz * kxz - kxy * kzz, kxy * kyz - kyy * kxz
    both_x = -(det3 * (dx * cx + dy * cy + dz * cz))
    cx, cy, cz = dy * kzz - dz * kyz, dz * kxz - dx * kzz, dx * kyz - dy * kxz
    both_y = -(det3 * (kxx * cx + kxy * cy + kxz * cz))
    cx, cy, cz = kyy * dz - kyz * dy, kyz * dx - kxy * dz, kxy * dy - kyy * dx
    both_z = -(det3 * (kxx * cx + kxy * cy + kxz * cz))
    # where the limit would have to pull, which it cannot
    rx, ry = -dx + iz * kxz, -dy + iz * kyz
    loose_x = det2 * (kyy * rx - kxy * ry)
    loose_y = det2 * (kxx * ry - kxy * rx)
    total = iz + both_z
    loose = (limit < 0) & (total < ZERO) | (limit > 0) & (total > ZERO)
    free = limit == 0
    px = hinge_x if free else loose_x if loose else both_x
    py = hinge_y if free else loose_y if loose else both_y
    pz = -iz if loose else both_z
    turn_a, turn_b = arm_ax * py - arm_ay * px, arm_bx * py - arm_by * px
    aw -= IA * (turn_a if free else turn_a + pz)
    bw += IB * (turn_b if free else turn_b + pz)
    ax -= MA * px
    ay -= MA * py
    bx += MB * px
    by += MB * py
    lanes.ix[j, lane] += px
    lanes.iy[j, lane] += py
    lanes.iz[j, lane] = iz if free else ZERO if loose else total
    lanes.motor[j, lane] = now
    return ax, ay, aw, bx, by, bw


@compiled
def joint_positions(j, lander, leg, limit):
    """Move the lander and a leg once to where the hinge holds them; return whether they were near enough."""
    off = ZERO
    if limit != 0:
        angle = leg.angle - lander.angle - REFERENCE[j]
        if limit < 0:
            c = angle - LOWER[j]
            off = -c
            c = clamp(c + ANGULAR_SLOP, -MOST_ANGULAR_CORRECTION, ZERO)
        else:
            c = angle - UPPER[j]
            off = c
            c = clamp(c - ANGULAR_SLOP, ZERO, MOST_ANGULAR_CORRECTION)
        impulse = -MOTOR_MASS * c
        lander.angle -= IA * impulse
        leg.angle += IB * impulse
    ax, ay = rotated(np.sin(lander.angle), np.cos(lander.angle), ANCHOR_A[0], ANCHOR_A[1])
    bx, by = rotated(np.sin(leg.angle), np.cos(leg.angle), ANCHOR_B[j, 0], ANCHOR_B[j, 1])
    cx, cy = leg.cx + bx - lander.cx - ax, leg.cy + by - lander.cy - ay
    kxx = MA + MB + IA * ay * ay + IB * by * by
    kxy = -IA * ax * ay - IB * bx * by
    kyy = MA + MB + IA * ax * ax + IB * bx * bx
    det = kxx * kyy - kxy * kxy
    if det != ZERO:
        det = ONE / det
    px, py = -(det * (kyy * cx - kxy * cy)), -(det * (kxx * cy - kxy * cx))
    lander.cx -= MA * px
    lander.cy -= MA * py
    lander.angle -= IA * (ax * py - ay * px)
    leg.cx += MB * px
    leg.cy += MB * py
    leg.angle += IB * (bx * py - by * px)
    return np.sqrt(cx * cx + cy * cy) <= SLOP and off <= ANGULAR_SLOP
