"""One sampled path of a point that is pushed around alike in all directions: dx = G u dt + B dw, BB' = b^2 I.

What `rollout_any` does, in numbers instead of small arrays, which takes a third of the time.
"""

from __future__ import annotations

import math

import numpy as np

from pirrht.cuts import key_of_step
from pirrht.dynamics import Dynamics, no_drift
from pirrht.exits import INSIDE, at_crossing, bridge_exit, distances, endpoint_exit, survivors_slope
from pirrht.gates import next_gate
from pirrht.jit import kernel
from pirrht.noise import normal, stream, twin


def is_point(d: Dynamics) -> bool:
    """Whether the dynamics are of this kind."""
    if not (d.n == d.m == 2 and d.drift is no_drift and isinstance(d.diffusion_block, np.ndarray)):
        return False
    cov = d.diffusion_block @ d.diffusion_block.T
    return bool(cov[0, 1] == 0.0 and cov[0, 0] == cov[1, 1])


@kernel
def point_room(guides):  # type: ignore[no-untyped-def]
    """Scratch of `point_path`: the two components of a, and the gates passed, by reference."""
    H = guides.control.shape[0]
    return np.empty(H), np.empty(H), np.empty(H, np.int64)


@kernel
def point_path(world, guides, room, h, x0, seed, sample, ratio, states, applied, led_by, base):  # type: ignore[no-untyped-def]
    """Simulate one sample; arguments and returns are those of `rollout_any`."""
    field, goal, radius, cuts, bridge = world.field, world.goal, world.goal_radius, world.cuts, world.bridge
    times, drifts, count, active = guides.times, guides.drift, guides.gates.count, guides.active
    place, mean, C = guides.gates.place.ctypes.data, guides.gates.mean.ctypes.data, guides.gates.place.shape[1]
    decay, speed, reach = guides.gates.decay, guides.speed, guides.reach
    D, inverse, B = world.gain, world.inverse, world.diffusion
    b00, b01, b10, b11 = B[0, 0], B[0, 1], B[1, 0], B[1, 1]
    d00, d01, d10, d11 = D[0, 0], D[0, 1], D[1, 0], D[1, 1]
    variance = b00 * b00 + b01 * b01
    deviation = math.sqrt(variance)
    a0, a1, stage = room
    H, T = guides.control.shape[0], guides.control.shape[1]
    weigh, draw = ratio.shape[0] > 0, states.shape[0] > 0
    low, high = (0, H) if weigh else (h, h + 1)
    for g in range(low, high):
        stage[g] = 0
    x, y, work, key = x0[0], x0[1], 0.0, np.int64(0)
    first, sign = twin(sample, guides.first[h], guides.mirrored)
    state = stream(seed, first)
    before = distances(field, goal, radius, x, y)
    if draw:
        states[0, 0], states[0, 1] = x, y
    for i in range(T):
        dt = times[i + 1] - times[i]
        root, until = math.sqrt(dt), dt
        # The push B' grad log h away from the nearest wall, h = erf(c / reach): survivors lean that way anyway.
        push0, push1, hurry = 0.0, 0.0, 1.0
        if 0.0 < before[0] < 3.0 * reach or 0.0 < before[1] < 3.0 * reach:
            gx, gy, width = survivors_slope(field, reach, deviation * root, x, y)
            push0, push1 = b00 * gx + b10 * gy, b01 * gx + b11 * gy
            if width < np.inf:  # psi goes like exp(-sqrt(k^2 + (pi/width)^2) r) in a channel
                hurry = math.sqrt(1.0 + (math.pi / (decay * width)) ** 2)
        for g in range(low, high):
            one, two = push0, push1
            if i < active[g]:
                one, two = push0 + drifts[g, i, 0], push1 + drifts[g, i, 1]
            if count[g] > 0:
                stage[g], dx, dy = next_gate(place, mean, g * C, count[g] - 1, stage[g], x, y, decay)
                scale = hurry * speed / max(math.sqrt(dx * dx + dy * dy), 1e-9)
                one += scale * (d00 * dx + d01 * dy)
                two += scale * (d10 * dx + d11 * dy)
            a0[g], a1[g] = one, two
        state, z0 = normal(state)
        state, z1 = normal(state)
        y0, y1 = sign * z0 * root + a0[h] * dt, sign * z1 * root + a1[h] * dt
        dx, dy = b00 * y0 + b01 * y1, b10 * y0 + b11 * y1
        nx, ny = x + dx, y + dy
        key += key_of_step(cuts, x, y, nx, ny)
        if bridge:
            after = distances(field, goal, radius, nx, ny)
            step = variance * dt
            state, exit, share = bridge_exit(field, goal, radius, x, y, nx, ny, before, after, (step, 0.0, step), state)
            before = after
            if exit != INSIDE:
                # Without this the rest of the step would enter dQ/dP as noise with a variance of a'a dt.
                state, dx, dy = at_crossing(field, goal, x, y, dx, dy, exit, share, radius, math.sqrt(step), state)
                y0, y1 = (b00 * dx + b10 * dy) / variance, (b01 * dx + b11 * dy) / variance
                nx, ny, until = x + dx, y + dy, dt * share
        else:
            exit, share = endpoint_exit(field, goal, radius, nx, ny)
            if reach > 0.0:
                before = distances(field, goal, radius, nx, ny)
        if weigh:
            for g in range(H):
                ratio[g] += a0[g] * (y0 - 0.5 * a0[g] * until) + a1[g] * (y1 - 0.5 * a1[g] * until)
        if i < applied.shape[0]:
            applied[i, 0] = (inverse[0, 0] * y0 + inverse[0, 1] * y1) / dt
            applied[i, 1] = (inverse[1, 0] * y0 + inverse[1, 1] * y1) / dt
        if i < led_by.shape[0]:
            led_by[i, 0] = (inverse[0, 0] * a0[h] + inverse[0, 1] * a1[h]) * until / dt
            led_by[i, 1] = (inverse[1, 0] * a0[h] + inverse[1, 1] * a1[h]) * until / dt
            if i == 0:
                bare0, bare1 = a0[h] - push0, a1[h] - push1
                base[0] = inverse[0, 0] * bare0 + inverse[0, 1] * bare1
                base[1] = inverse[1, 0] * bare0 + inverse[1, 1] * bare1
        work += world.rate * dt * share
        x, y = nx, ny
        if draw:
            states[i + 1, 0], states[i + 1, 1] = x, y
        if exit != INSIDE:
            return work, key, exit, i + 1, until
    return work, key, 0, T, times[T] - times[T - 1]
