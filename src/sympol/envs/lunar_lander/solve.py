"""Velocities and positions that joints and contacts allow: Box2D's sequential impulses, to the bit.

Box2D solves velocities 180 times over, as Gymnasium asks. In the air nothing moves any more after a few times: the rest
is told without solving anything, which is most of why this is fast.
"""

from __future__ import annotations

import numpy as np

from .collide import SKIN, kind_of, placed, rotated, transform
from .layout import HALF, ONE, ZERO, F
from .machine import compiled
from .shapes import FPS, HULL, LEG, LEG_AWAY, LEG_DOWN, LEG_SIDES

DT = F(1 / FPS)
GRAVITY = F(-10)
VELOCITY_ITERATIONS, POSITION_ITERATIONS, TOI_POSITION_ITERATIONS = 180, 60, 20
SLOP, ANGULAR_SLOP = F(0.005), F(2) / F(180) * F(3.14159265359)
MOST_CORRECTION, MOST_ANGULAR_CORRECTION = F(0.2), F(8) / F(180) * F(3.14159265359)
BAUMGARTE, TOI_BAUMGARTE = F(0.2), F(0.75)
CONDITION = F(1000)
"""Two points that are nearer to being one than this are solved as one."""
TIME_TO_SLEEP, SLEEPY, SLEEPY_SPIN = F(0.5), F(0.01), F(2) / F(180) * F(3.14159265359)

INVERSE_MASS = np.array([HULL.inverse_mass, LEG.inverse_mass])
INVERSE_INERTIA = np.array([HULL.inverse_inertia, LEG.inverse_inertia])
CENTERS = np.stack([HULL.center, LEG.center])
MA, MB, IA, IB = HULL.inverse_mass, LEG.inverse_mass, HULL.inverse_inertia, LEG.inverse_inertia
ANCHOR_A = (ZERO - HULL.center[0], ZERO - HULL.center[1])
"""Of the joints, from the lander's centre of mass."""
ANCHOR_B = np.array([[F(side * LEG_AWAY), F(LEG_DOWN)] for side in LEG_SIDES], np.float32) - LEG.center
SPEED = np.array([0.3 * side for side in LEG_SIDES], np.float32)
"""Of the motors that push the legs out."""
MOST_TORQUE = DT * F(40)
LOWER, UPPER = np.array([0.9 - 0.5, -0.9], np.float32), np.array([0.9, -0.9 + 0.5], np.float32)
MOTOR_MASS = ONE / (IA + IB)
REFERENCE = np.array([0.05 * side for side in LEG_SIDES], np.float32)
"""Angles between legs and lander at the beginning, from which others are counted."""


@compiled
def clamp(x, low, high):
    """Between two bounds."""
    return max(low, min(x, high))


@compiled
def prepare_joint(joint, j, lander, leg):
    """What stays as it is while velocities are solved; apply last step's impulses."""
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


@compiled
def solve_joint(joint, j, ax, ay, aw, bx, by, bw, ix, iy, iz, im):
    """Once: velocities of the lander and of a leg after motor, limit and hinge have had their say, the impulses in all,
    and what was added to those of hinge and limit."""
    impulse = -MOTOR_MASS * (bw - aw - SPEED[j])
    now = clamp(im + impulse, -MOST_TORQUE, MOST_TORQUE)
    impulse, im = now - im, now
    aw -= IA * impulse
    bw += IB * impulse
    dx = bx - bw * joint.by - ax + aw * joint.ay
    dy = by + bw * joint.bx - ay - aw * joint.ax
    if joint.limit == 0:
        px = joint.det2 * (joint.kyy * -dx - joint.kxy * -dy)
        py = joint.det2 * (joint.kxx * -dy - joint.kxy * -dx)
        ix += px
        iy += py
        pz = ZERO
        aw -= IA * (joint.ax * py - joint.ay * px)
        bw += IB * (joint.bx * py - joint.by * px)
    else:
        dz = bw - aw
        kxx, kxy, kxz, kyy, kyz, kzz = joint.kxx, joint.kxy, joint.kxz, joint.kyy, joint.kyz, joint.kzz
        cx, cy, cz = kyy * kzz - kyz * kyz, kyz * kxz - kxy * kzz, kxy * kyz - kyy * kxz
        px = -(joint.det3 * (dx * cx + dy * cy + dz * cz))
        cx, cy, cz = dy * kzz - dz * kyz, dz * kxz - dx * kzz, dx * kyz - dy * kxz
        py = -(joint.det3 * (kxx * cx + kxy * cy + kxz * cz))
        cx, cy, cz = kyy * dz - kyz * dy, kyz * dx - kxy * dz, kxy * dy - kyy * dx
        pz = -(joint.det3 * (kxx * cx + kxy * cy + kxz * cz))
        if (iz + pz < ZERO) if joint.limit < 0 else (iz + pz > ZERO):
            rx, ry = -dx + iz * kxz, -dy + iz * kyz
            px = joint.det2 * (kyy * rx - kxy * ry)
            py = joint.det2 * (kxx * ry - kxy * rx)
            pz = -iz
            ix += px
            iy += py
            iz = ZERO
        else:
            ix += px
            iy += py
            iz += pz
        aw -= IA * ((joint.ax * py - joint.ay * px) + pz)
        bw += IB * ((joint.bx * py - joint.by * px) + pz)
    ax -= MA * px
    ay -= MA * py
    bx += MB * px
    by += MB * py
    return ax, ay, aw, bx, by, bw, ix, iy, iz, im, px, py, pz


@compiled
def joint_positions(j, lander, leg, limit):
    """Once: move the lander and a leg to where the hinge holds; whether it nearly did."""
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


@compiled
def pulls(limit, impulse, added, times):
    """Whether an impulse at a limit, which may only push, could come near to zero by being added to so many times."""
    return limit != 0 and added != ZERO and abs(impulse) <= F(2) * abs(added) * F(times)


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
def integrate(body, dt):
    """Move."""
    body.cx += dt * body.vx
    body.cy += dt * body.vy
    body.angle += dt * body.spin


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
    sleep = F(3.4e38)
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
