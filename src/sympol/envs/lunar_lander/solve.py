"""Velocities and positions that joints and contacts allow: Box2D's sequential impulses, to the bit.

Box2D solves velocities 180 times over, as Gymnasium asks. In the air nothing moves any more after a few times: the rest
is told without solving anything, which is most of why this is fast.
"""

from __future__ import annotations

import numpy as np

from .bodies import CENTERS, FARTHEST, integrate, kind_of, transform
from .contacts import BAUMGARTE, TOI_BAUMGARTE, contact_positions, prepare_contact, solve_contact, warm_start
from .joints import DT, MA, SLOP, joint_positions, prepare_joint, pulls, solve_joint
from .layout import ZERO, F
from .machine import compiled

GRAVITY = F(-10)
VELOCITY_ITERATIONS, POSITION_ITERATIONS, TOI_POSITION_ITERATIONS = 180, 60, 20
TIME_TO_SLEEP, SLEEPY, SLEEPY_SPIN = F(0.5), F(0.01), F(2) / F(180) * F(3.14159265359)


@compiled
def solve_velocities(landing):
    """As often as Gymnasium asks. Where velocities do not change any more, impulses still do, by what is too little to
    move anything: they only add up then."""
    bodies, joints = landing.bodies, landing.joints
    lander, left, right = bodies[0], bodies[1], bodies[2]
    ax, ay, aw = lander.vx, lander.vy, lander.spin
    lx, ly, lw = left.vx, left.vy, left.spin
    rx, ry, rw = right.vx, right.vy, right.spin
    j0, j1 = joints[0], joints[1]
    i0x, i0y, i0z, i0m = j0.ix, j0.iy, j0.iz, j0.motor
    i1x, i1y, i1z, i1m = j1.ix, j1.iy, j1.iz, j1.motor
    times = 0
    while times < VELOCITY_ITERATIONS:
        times += 1
        oax, oay, oaw, olx, oly, olw, orx, ory, orw, o0m, o1m = ax, ay, aw, lx, ly, lw, rx, ry, rw, i0m, i1m
        ax, ay, aw, rx, ry, rw, i1x, i1y, i1z, i1m, p1x, p1y, p1z = solve_joint(
            j1, 1, ax, ay, aw, rx, ry, rw, i1x, i1y, i1z, i1m
        )
        ax, ay, aw, lx, ly, lw, i0x, i0y, i0z, i0m, p0x, p0y, p0z = solve_joint(
            j0, 0, ax, ay, aw, lx, ly, lw, i0x, i0y, i0z, i0m
        )
        changed = False
        for k in range(right.contacts):
            if landing.contacts[2, k].touching:
                rx, ry, rw, more = solve_contact(landing.contacts[2, k], landing.points[2, k], rx, ry, rw)
                changed = changed or more
        for k in range(left.contacts):
            if landing.contacts[1, k].touching:
                lx, ly, lw, more = solve_contact(landing.contacts[1, k], landing.points[1, k], lx, ly, lw)
                changed = changed or more
        if changed or ax != oax or ay != oay or aw != oaw or lx != olx or ly != oly or lw != olw:
            continue
        if rx != orx or ry != ory or rw != orw or i0m != o0m or i1m != o1m:
            continue
        left_over = VELOCITY_ITERATIONS - times
        if pulls(j0.limit, i0z, p0z, left_over) or pulls(j1.limit, i1z, p1z, left_over):
            continue
        for _ in range(left_over):
            i0x, i0y, i0z, i1x, i1y, i1z = i0x + p0x, i0y + p0y, i0z + p0z, i1x + p1x, i1y + p1y, i1z + p1z
        break
    lander.vx, lander.vy, lander.spin = ax, ay, aw
    left.vx, left.vy, left.spin = lx, ly, lw
    right.vx, right.vy, right.spin = rx, ry, rw
    j0.ix, j0.iy, j0.iz, j0.motor = i0x, i0y, i0z, i0m
    j1.ix, j1.iy, j1.iz, j1.motor = i1x, i1y, i1z, i1m


@compiled
def solve(landing, force_x, force_y):
    """One step of all that hangs together; whether the lander fell asleep."""
    bodies, joints, contacts, points = landing.bodies, landing.joints, landing.contacts, landing.points
    for b in range(3):
        body = bodies[b]
        body.cx0, body.cy0, body.angle0, body.alpha0 = body.cx, body.cy, body.angle, ZERO
        if b == 0:
            body.vx += DT * (MA * force_x)
            body.vy += DT * (GRAVITY + MA * force_y)
        else:
            body.vy += DT * GRAVITY
    for b in (2, 1):
        for k in range(bodies[b].contacts):
            if contacts[b, k].touching:
                prepare_contact(contacts[b, k], points[b, k], landing.edges[contacts[b, k].edge], bodies[b])
    for b in (2, 1):
        for k in range(bodies[b].contacts):
            if contacts[b, k].touching:
                warm_start(contacts[b, k], points[b, k], bodies[b])
    for j in (1, 0):
        prepare_joint(joints[j], j, bodies[0], bodies[j + 1])
    solve_velocities(landing)
    for b in range(3):
        integrate(bodies[b], DT)
    solved = False
    for _ in range(POSITION_ITERATIONS):
        deepest = ZERO
        for b in (2, 1):
            for k in range(bodies[b].contacts):
                if contacts[b, k].touching:
                    deepest = min(
                        deepest, contact_positions(contacts[b, k], points[b, k], bodies[b], BAUMGARTE)
                    )
        okay = deepest >= F(-3) * SLOP
        for j in (1, 0):
            okay = joint_positions(j, bodies[0], bodies[j + 1], joints[j].limit) and okay
        if okay:
            solved = True
            break
    sleep = FARTHEST
    for b in range(3):
        body = bodies[b]
        center = CENTERS[kind_of(b)]
        transform(body, center[0], center[1])
        if body.spin * body.spin > SLEEPY_SPIN * SLEEPY_SPIN or (
            body.vx * body.vx + body.vy * body.vy > SLEEPY * SLEEPY
        ):
            body.sleep = ZERO
        else:
            body.sleep += DT
        sleep = min(sleep, body.sleep)
    return sleep >= TIME_TO_SLEEP and solved


@compiled
def nth(i, first):
    """Numbers from 0 on, but ``first`` first."""
    return first if i == 0 else i - 1 if i <= first else i


@compiled
def solve_impact(landing, b, first, dt):
    """The rest of a step of a leg that has just come to the ground, by itself."""
    body, contacts, points = landing.bodies[b], landing.contacts[b], landing.points[b]
    for _ in range(TOI_POSITION_ITERATIONS):
        deepest = ZERO
        for i in range(body.contacts):
            k = nth(i, first)
            if contacts[k].touching:
                deepest = min(deepest, contact_positions(contacts[k], points[k], body, TOI_BAUMGARTE))
        if deepest >= F(-1.5) * SLOP:
            break
    body.cx0, body.cy0, body.angle0 = body.cx, body.cy, body.angle
    transform(body, CENTERS[1, 0], CENTERS[1, 1])
    kept = np.empty((body.contacts, 2, 2), np.float32)
    for k in range(body.contacts):
        for i in range(2):  # such impulses can be large, and are not for the next step to begin with
            kept[k, i, 0], kept[k, i, 1] = points[k, i].normal, points[k, i].tangent
            points[k, i].normal, points[k, i].tangent = ZERO, ZERO
        if contacts[k].touching:
            prepare_contact(contacts[k], points[k], landing.edges[contacts[k].edge], body)
    vx, vy, spin = body.vx, body.vy, body.spin
    for _ in range(VELOCITY_ITERATIONS):
        changed = False
        for i in range(body.contacts):
            k = nth(i, first)
            if contacts[k].touching:
                vx, vy, spin, more = solve_contact(contacts[k], points[k], vx, vy, spin)
                changed = changed or more
        if not changed:
            break
    body.vx, body.vy, body.spin = vx, vy, spin
    for k in range(body.contacts):
        for i in range(2):
            points[k, i].normal, points[k, i].tangent = kept[k, i, 0], kept[k, i, 1]
    integrate(body, dt)
    transform(body, CENTERS[1, 0], CENTERS[1, 1])
