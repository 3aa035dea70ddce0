"""One step of the world: contacts, velocities and positions, then impacts within the step."""

from __future__ import annotations

from .bodies import CENTERS, kind_of, transform
from .broadphase import update_box
from .collide import add_contacts, report_contact, update_contact, update_contacts
from .distance import EPSILON
from .joints import DT
from .layout import ONE, ZERO, F
from .machine import compiled
from .solve import prepare_step, solve_impact, solve_positions
from .time_of_impact import time_of_impact

SUBSTEPS = 8


@compiled
def begin_step(landing, force_x, force_y):
    """Begin a step: update contacts and apply forces. Velocities are to be solved next."""
    for b in (2, 1, 0):
        update_contacts(landing, b)
    prepare_step(landing, force_x, force_y)


@compiled
def end_step(landing, lanes):
    """End a step whose velocities are solved: move everything; return whether the lander has come to rest.

    Where the lander itself touches the ground, the episode is over: its bounce is not simulated.
    """
    bodies = landing.bodies
    asleep = solve_positions(landing)
    for b in range(3):
        if update_box(bodies[b], kind_of(b), CENTERS[kind_of(b), 0], CENTERS[kind_of(b), 1]):
            add_contacts(landing, b)
    if asleep:
        for b in range(3):
            bodies[b].vx, bodies[b].vy, bodies[b].spin = ZERO, ZERO, ZERO
        return True
    _solve_impacts(landing, lanes)
    return False


@compiled
def _check_crash(landing):
    """Tell the game where the lander itself reaches the ground within the step."""
    lander = landing.bodies[0]
    cx, cy, angle = lander.cx, lander.cy, lander.angle
    for k in range(lander.contacts):
        contact = landing.contacts[0, k]
        t = time_of_impact(
            landing.edges[contact.edge], 0, lander.cx0, lander.cy0, lander.angle0, cx, cy, angle
        )
        if t == ONE or contact.touching:
            continue
        lander.cx, lander.cy = (ONE - t) * lander.cx0 + t * cx, (ONE - t) * lander.cy0 + t * cy
        lander.angle = (ONE - t) * lander.angle0 + t * angle
        transform(lander, CENTERS[0, 0], CENTERS[0, 1])
        report_contact(landing, 0, update_contact(landing, 0, k))
        lander.cx, lander.cy, lander.angle = cx, cy, angle
        transform(lander, CENTERS[0, 0], CENTERS[0, 1])


@compiled
def _solve_impacts(landing, lanes):
    """Solve the impacts of legs that reach the ground within the step."""
    bodies, contacts = landing.bodies, landing.contacts
    for b in range(3):
        for k in range(bodies[b].contacts):
            contacts[b, k].has_toi, contacts[b, k].toi, contacts[b, k].substeps = 0, ONE, 0
    _check_crash(landing)
    ground = ZERO  # the part of the step to which the ground has advanced: that of the last impact
    while True:
        first, at, soonest = -1, 0, ONE
        for b in (2, 1):
            body = bodies[b]
            for k in range(body.contacts):
                contact = contacts[b, k]
                if not contact.enabled or contact.substeps > SUBSTEPS:
                    continue
                if not contact.has_toi:
                    if body.alpha0 < ground:
                        _advance_sweep(body, ground)
                    elif ground < body.alpha0:
                        ground = body.alpha0
                    beta = time_of_impact(
                        landing.edges[contact.edge],
                        1,
                        body.cx0,
                        body.cy0,
                        body.angle0,
                        body.cx,
                        body.cy,
                        body.angle,
                    )
                    contact.toi = min(ground + (ONE - ground) * beta, ONE) if beta < ONE else ONE
                    contact.has_toi = 1
                if contact.toi < soonest:
                    first, at, soonest = b, k, contact.toi
        if first < 0 or ONE - F(10) * EPSILON < soonest:
            return
        body, contact = bodies[first], contacts[first, at]
        cx, cy, angle = body.cx, body.cy, body.angle
        cx0, cy0, angle0, alpha0, ground0 = body.cx0, body.cy0, body.angle0, body.alpha0, ground
        _advance_sweep(body, soonest)
        ground = soonest
        body.cx, body.cy, body.angle = body.cx0, body.cy0, body.angle0
        transform(body, CENTERS[1, 0], CENTERS[1, 1])
        report_contact(landing, first, update_contact(landing, first, at))
        contact.has_toi = 0
        contact.substeps += 1
        if not contact.touching:
            contact.enabled = 0
            body.cx, body.cy, body.angle = cx, cy, angle
            body.cx0, body.cy0, body.angle0, body.alpha0, ground = cx0, cy0, angle0, alpha0, ground0
            transform(body, CENTERS[1, 0], CENTERS[1, 1])
            continue
        for k in range(body.contacts):
            if k != at:
                report_contact(landing, first, update_contact(landing, first, k))
        solve_impact(landing, first, at, (ONE - soonest) * DT, lanes)
        for k in range(body.contacts):
            contacts[first, k].has_toi = 0
        if update_box(body, 1, CENTERS[1, 0], CENTERS[1, 1]):
            add_contacts(landing, first)


@compiled
def _advance_sweep(body, alpha):
    """Advance the beginning of a body's sweep."""
    beta = (alpha - body.alpha0) / (ONE - body.alpha0)
    body.cx0 = (ONE - beta) * body.cx0 + beta * body.cx
    body.cy0 = (ONE - beta) * body.cy0 + beta * body.cy
    body.angle0 = (ONE - beta) * body.angle0 + beta * body.angle
    body.alpha0 = alpha
