"""A step of the jointed bodies before and after their velocities are solved, and the rest of a step of a leg that
reaches the ground within it; as Box2D, to the bit."""

from __future__ import annotations

import numpy as np

from .bodies import CENTERS, FARTHEST, integrate, kind_of, transform
from .contacts import BAUMGARTE, TOI_BAUMGARTE, contact_positions, prepare_contact, warm_start
from .joints import DT, MA, SLOP, joint_positions, prepare_joint
from .layout import ZERO, F
from .machine import compiled
from .velocities import solve_alone

GRAVITY = F(-10)
POSITION_ITERATIONS, TOI_POSITION_ITERATIONS = 60, 20
TIME_TO_SLEEP, SLEEPY, SLEEPY_SPIN = F(0.5), F(0.01), F(2) / F(180) * F(3.14159265359)


@compiled
def prepare_step(landing, force_x, force_y):
    """Begin a step: apply forces and the last step's impulses."""
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


@compiled
def solve_positions(landing):
    """End a step whose velocities are solved: move the bodies; return whether the lander fell asleep."""
    bodies, joints, contacts, points = landing.bodies, landing.joints, landing.contacts, landing.points
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
def solve_impact(landing, b, first, dt, lanes):
    """Solve the rest of a step of a leg that has just reached the ground, by itself, beginning with contact
    ``first``."""
    body, contacts, points = landing.bodies[b], landing.contacts[b], landing.points[b]
    order = np.array([first, *[k for k in range(body.contacts) if k != first]])
    for _ in range(TOI_POSITION_ITERATIONS):
        deepest = ZERO
        for k in order:
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
    solve_alone(body, contacts, points, order, lanes)
    for k in range(body.contacts):
        for i in range(2):
            points[k, i].normal, points[k, i].tangent = kept[k, i, 0], kept[k, i, 1]
    integrate(body, dt)
    transform(body, CENTERS[1, 0], CENTERS[1, 1])
