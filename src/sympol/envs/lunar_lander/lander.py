"""The game: starts, engines, observations and rewards, as in Gymnasium, to the bit.

Random numbers are from a generator of its own, so that a seed is one episode: the same number is the same everywhere.
"""

from __future__ import annotations

import math

import numpy as np

from .bodies import CENTERS, SKIN, kind_of
from .broadphase import EXTENSION, init_box
from .joints import IA, MA
from .layout import LANES, ONE, ZERO, F, landing_at
from .machine import compiled
from .shapes import CHUNKS, EDGES, FPS, HEIGHT, LEG_AWAY, LEG_DOWN, LEG_SIDES, SCALE, WIDTH
from .velocities import solve_velocities
from .world import begin_step, end_step

FEATURES = 8
LIMIT = 1000
"""Number of steps after which an episode is truncated."""
TINY = np.finfo(np.float32).smallest_normal
"""Observations nearer to zero than this are zero."""
MAIN_POWER, SIDE_POWER = 13.0, 0.6
MAIN_Y, SIDE_AWAY, SIDE_HEIGHT, SIDE_DOWN = 4.0, 12.0, 14.0, 17.0
INITIAL = 1000.0
"""The largest force of the first push, in newtons."""
PAD = HEIGHT / 4
"""Height of the ground between the flags."""
_GOLDEN, _MIX1, _MIX2 = (
    np.uint64(0x9E3779B97F4A7C15),
    np.uint64(0xBF58476D1CE4E5B9),
    np.uint64(0x94D049BB133111EB),
)
ROUGH, SMOOTH = np.sqrt(F(0.2) * F(0.2)), np.sqrt(F(0.1) * F(0.2))
"""Friction of a leg on the level edge, and on the ground."""


@compiled
def random_float(game):
    """Draw a float64 in [0, 1): SplitMix64 (Steele, Lea and Flood 2014)."""
    game.random += _GOLDEN
    z = game.random
    z = (z ^ (z >> np.uint64(30))) * _MIX1
    z = (z ^ (z >> np.uint64(27))) * _MIX2
    z = z ^ (z >> np.uint64(31))
    return (z >> np.uint64(11)) * 2.0**-53


@compiled
def uniform(game, low, high):
    """Draw a number between two bounds."""
    return low + (high - low) * random_float(game)


@compiled
def _place_edge(edge, x1, y1, x2, y2, friction):
    edge.x1, edge.y1, edge.x2, edge.y2, edge.friction = F(x1), F(y1), F(x2), F(y2), friction
    dx, dy = edge.x2 - edge.x1, edge.y2 - edge.y1
    part = ONE / np.sqrt(dx * dx + dy * dy)
    edge.nx, edge.ny = dy * part, -(dx * part)
    r = EXTENSION
    edge.low_x, edge.low_y = (min(edge.x1, edge.x2) - SKIN) - r, (min(edge.y1, edge.y2) - SKIN) - r
    edge.high_x, edge.high_y = (max(edge.x1, edge.x2) + SKIN) + r, (max(edge.y1, edge.y2) + SKIN) + r


@compiled
def start(landings, at, seed, observation, lanes):
    """Start an episode, and store the first observation."""
    landing = landing_at(landings, at)
    game, bodies, edges = landing.game[0], landing.bodies, landing.edges
    game.random = np.uint64(seed)
    game.begun, game.crashed, game.left, game.right, game.time = 0, 0, 0, 0, 0
    height = np.empty(CHUNKS + 1)
    for i in range(CHUNKS + 1):
        height[i] = uniform(game, 0.0, HEIGHT / 2)
    for i in range(CHUNKS // 2 - 2, CHUNKS // 2 + 3):
        height[i] = PAD
    smooth = np.empty(CHUNKS)
    for i in range(CHUNKS):
        smooth[i] = 0.33 * (height[i - 1] + height[i] + height[i + 1])
    _place_edge(edges[0], 0.0, 0.0, WIDTH, 0.0, ROUGH)
    for i in range(1, EDGES):
        step = WIDTH / (CHUNKS - 1)
        _place_edge(edges[i], step * (i - 1), smooth[i - 1], step * i, smooth[i], SMOOTH)
    force_x, force_y = F(uniform(game, -INITIAL, INITIAL)), F(uniform(game, -INITIAL, INITIAL))
    for b in range(3):
        body = bodies[b]
        side = LEG_SIDES[b - 1] if b > 0 else 0
        kind = kind_of(b)
        body.px, body.py, body.angle = F(WIDTH / 2 - side * LEG_AWAY), F(HEIGHT), F(side * 0.05)
        body.sin, body.cos = np.sin(body.angle), np.cos(body.angle)
        mx, my = CENTERS[kind, 0], CENTERS[kind, 1]
        body.cx = (body.cos * mx - body.sin * my) + body.px
        body.cy = (body.sin * mx + body.cos * my) + body.py
        body.vx, body.vy, body.spin, body.sleep, body.contacts = ZERO, ZERO, ZERO, ZERO, 0
        init_box(body, kind)
    for j in range(2):
        joint = landing.joints[j]
        joint.ix, joint.iy, joint.iz, joint.motor, joint.limit = ZERO, ZERO, ZERO, ZERO, 0
    _fire_engines(landing, 0.0, 0.0)
    begin_step(landing, force_x, force_y)
    solve_velocities(landings, np.array([at]), lanes)
    _finish_step(landing, 0.0, 0.0, observation, lanes)
    game.time = 0


@compiled
def step(landings, which, power, observation, reward, ends, lanes):
    """Take one step of some landings; ``which`` are their numbers, and the rows of all arrays.

    Stores observations, rewards, and in ``ends`` whether an episode is terminated or truncated. ``power`` is that of
    the main engine, 0 or 0.5 to 1, and that of a side engine, negative for the left one.
    """
    for at in which:
        landing = landing_at(landings, at)
        _fire_engines(landing, power[at, 0], power[at, 1])
        begin_step(landing, ZERO, ZERO)
    order = _airborne_first(landings, which)
    for i in range(0, len(order), LANES):
        solve_velocities(landings, order[i : i + LANES], lanes)
    for at in which:
        reward[at], ends[at, 0], ends[at, 1] = _finish_step(
            landing_at(landings, at), power[at, 0], power[at, 1], observation[at], lanes
        )


@compiled
def _airborne_first(landings, which):
    """Sort landings on the ground to the end: they take longer to solve, and so are solved together."""
    order, first, last = np.empty(len(which), np.int64), 0, len(which)
    for at in which:
        if landings.game[at, 0].left or landings.game[at, 0].right:
            last -= 1
            order[last] = at
        else:
            order[first] = at
            first += 1
    return order


@compiled
def _fire_engines(landing, main, side):
    """Apply the impulses of the engines."""
    game, lander = landing.game[0], landing.bodies[0]
    tip_x, tip_y = math.sin(np.float64(lander.angle)), math.cos(np.float64(lander.angle))
    side_x, side_y = -tip_y, tip_x
    d0, d1 = uniform(game, -1.0, 1.0) / SCALE, uniform(game, -1.0, 1.0) / SCALE
    if main > 0:
        ox = tip_x * (MAIN_Y / SCALE + 2 * d0) + side_x * d1
        oy = -tip_y * (MAIN_Y / SCALE + 2 * d0) - side_y * d1
        _apply_impulse(
            lander, -ox * MAIN_POWER * main, -oy * MAIN_POWER * main, lander.px + ox, lander.py + oy
        )
    power = abs(side)
    if power > 0:
        direction = 1.0 if side > 0 else -1.0
        ox = tip_x * d0 + side_x * (3 * d1 + direction * SIDE_AWAY / SCALE)
        oy = -tip_y * d0 - side_y * (3 * d1 + direction * SIDE_AWAY / SCALE)
        x = lander.px + ox - tip_x * SIDE_DOWN / SCALE
        y = lander.py + oy + tip_y * SIDE_HEIGHT / SCALE
        _apply_impulse(lander, -ox * SIDE_POWER * power, -oy * SIDE_POWER * power, x, y)


@compiled
def _finish_step(landing, main, side, observation, lanes):
    """Move everything and store the observation; return reward, terminated and truncated."""
    asleep = end_step(landing, lanes)
    game, lander = landing.game[0], landing.bodies[0]
    half = WIDTH / 2
    x = (np.float64(lander.px) - half) / half
    y = (np.float64(lander.py) - (PAD + LEG_DOWN)) / (HEIGHT / 2)
    vx, vy = np.float64(lander.vx) * half / FPS, np.float64(lander.vy) * (HEIGHT / 2) / FPS
    observation[0], observation[1], observation[2], observation[3] = x, y, vx, vy
    observation[4], observation[5] = lander.angle, 20.0 * np.float64(lander.spin) / FPS
    observation[6], observation[7] = game.left, game.right
    for i in range(FEATURES):
        if abs(observation[i]) < TINY:
            observation[i] = ZERO
    shaping = (
        -100 * math.sqrt(x * x + y * y)
        - 100 * math.sqrt(vx * vx + vy * vy)
        - 100 * abs(np.float64(lander.angle))
        + 10.0 * game.left
        + 10.0 * game.right
    )
    reward = shaping - game.shaping if game.begun else 0.0
    game.shaping, game.begun = shaping, 1
    game.time += 1
    reward -= main * 0.30
    reward -= abs(side) * 0.03
    if asleep:
        return 100.0, True, game.time >= LIMIT
    if game.crashed or abs(x) >= 1.0:
        return -100.0, True, game.time >= LIMIT
    return reward, False, game.time >= LIMIT


@compiled
def _apply_impulse(body, ix, iy, x, y):
    """Apply an impulse at a point."""
    ix, iy, rx, ry = F(ix), F(iy), F(x) - body.cx, F(y) - body.cy
    body.vx += MA * ix
    body.vy += MA * iy
    body.spin += IA * (rx * iy - ry * ix)
