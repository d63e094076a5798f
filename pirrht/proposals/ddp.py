"""Compiled local optimisation of any system's trajectory, and the linear feedback that holds noisy paths near it.

Differential dynamic programming (Mayne, Int. J. Control 1966) on the steps of rollouts. In noise units
a = B_c^-1 G_c u (in input form s^-1 u) the control costs lambda a'a / 2 for any G, B and R; to q the clearance cost is
added. The quadratic model of the cost-to-go yields a = a_ref + K (x - x_ref) and the covariance that it leaves to the
noise of a step: lambda dt Q_aa^-1 of the passive one.
"""

import math
from functools import cache
from typing import Any

import numpy as np

from pirrht.geometry.space import COLLISION, pose_at
from pirrht.geometry.world import NOTHING_MOVES
from pirrht.jit.jit import kernel
from pirrht.jit.vectors import copy_row, copy_rows
from pirrht.proposals.backward_pass import backward_pass
from pirrht.proposals.forward_pass import forward_pass
from pirrht.proposals.guide import COURSE
from pirrht.proposals.tuning import TUNING
from pirrht.rollouts.first_exit import turn_of
from pirrht.rollouts.step import KernelSpec, algebra
from pirrht.topology.signature import NO_CLASSES


@cache
def optimiser(kind: KernelSpec) -> Any:
    """Build the kernel that optimises trajectories of one kind of dynamics."""
    velocity, _, _, forward = forward_pass(kind)
    backward = backward_pass(kind)

    n, m, _, _ = kind.sizes
    noisy_position = kind.noisy_position
    moving = kind.moving is not None

    watch, _, _, _, sweep_among, *_ = kind.moving or NOTHING_MOVES
    pose = pose_at(kind.reads)
    place = pose_at(kind.position)
    sweep = kind.space.sweep
    between, product = algebra(len(kind.position))
    planar = len(kind.position) == 2
    *_, key_of_step, _, watch_class, begin_class, follow_class = kind.classes or NO_CLASSES

    @kernel
    def _is_free(setup, states, length, times, bows):  # type: ignore[no-untyped-def]
        """Check that the first `length` steps of states (T+1, n), straight or bows, touch nothing."""
        f, turn = np.zeros((2, n)), 0.0
        if moving:
            notes = watch(setup.world.moving)
        for i in range(length):
            here = pose(states[i])
            there = pose(states[i + 1])
            dt = times[i + 1] - times[i]
            if bows and planar:
                velocity(setup, states[i], f[0])
                velocity(setup, states[i + 1], f[1])
                way = between(1.0, place(states[i + 1]), -1.0, place(states[i]))
                turn = turn_of(place(f[0]), place(f[1]), way, dt)
            outcome, _, _ = sweep(setup.world, here, there, turn, 0.0)
            if outcome == COLLISION or (
                moving and sweep_among(setup.world.moving, notes, (here, there, turn), times[i], dt, 1.0) <= 1.0
            ):
                return False
        return True

    @kernel
    def _judge(problem, states, length):  # type: ignore[no-untyped-def]
        """Check that a trajectory is of its class, and that it is and touches nothing; aims are held to unchecked."""
        (setup, classes, task, times, own, bows), key = problem, np.int64(0)
        if task.hold > 0.0:
            return True, True
        for i in range(length):
            key += key_of_step(classes.table, pose(states[i]), pose(states[i + 1]))
        if moving:
            sides = watch_class(classes.rays)
            key += begin_class(classes.rays, pose(states[0]), sides)
            for i in range(length):
                key += follow_class(classes.rays, i, 1.0, pose(states[i + 1]), sides)
        return key == own, key == own and _is_free(setup, states, length, times, bows)

    @kernel
    def _points(setup, task, states, length, times):  # type: ignore[no-untyped-def]
        """Return the number of points of every step at which clearance is priced, by the longest step."""
        longest = 0.0
        for i in range(length):
            step = between(1.0, place(states[i + 1]), -1.0, place(states[i]))
            way = math.sqrt(product(step, step))
            longest = max(longest, way + (setup.world.moving.speed * (times[i + 1] - times[i]) if moving else 0.0))
        return max(1, min(TUNING.points, math.ceil(TUNING.points_margin * longest / task.spacing)))

    @kernel
    def _search(problem, course, trial, points, expected, found):  # type: ignore[no-untyped-def]
        """Search along the change of the controls for a better trajectory, left in `trial`; return whether, and it.

        A trajectory is (steps, cost, priced, right, sound). From the first sound one on only sound ones are better.
        """
        setup, _, task, times, _, _ = problem
        steps, _, priced, right, sound = found
        step = 1.0
        for _ in range(TUNING.halvings):
            k, c, p = forward(setup, task, times, course, steps, step, points, trial)
            if k >= 0 and p < priced - TUNING.descent * step * expected:
                same, clear = _judge(problem, trial.states, k)
                if clear or (not sound and (same or not right)):
                    return True, (k, c, p, same, clear)
            step *= 0.5
        return False, found

    @kernel
    def optimise(setup, classes, task, times, key, rounds, course, length):  # type: ignore[no-untyped-def]
        """Improve a course in place; it never leaves its class, nor free space in its class, again.

        Its first `length` steps are followed, with its gains until the first of at most so many `rounds` of backward
        passes. `times` (T+1,) are ends of steps [s], on the clock of moving obstacles; the result must have the
        additive class `key`, unless aims are held to.
        Returns: steps that end outside the goal (-1: it does not get there), cost, cost with clearance priced [cost],
            whether it is of its class and touches nothing.
        """
        states, control, gains, share, inverse, volume, change, aims = course
        flat = not noisy_position and control.shape[1] > m
        other = np.zeros(states.shape)
        tried = np.zeros(control.shape)
        trial = COURSE(other, tried, gains, share, inverse, volume, change, aims)
        copy_row(states[0], other[0])
        steps, _, _ = forward(setup, task, times, course, length, 0.0, 1, trial)
        if steps < 0:
            return -1, np.inf, np.inf, False
        points = _points(setup, task, other, steps, times)
        steps, cost, priced = forward(setup, task, times, course, length, 0.0, points, trial)
        copy_rows(tried, control)
        copy_rows(other, states)
        problem = setup, classes, task, times, key, flat
        right, sound = _judge(problem, states, steps)
        found = steps, cost, priced, right, sound
        for k in range(m, control.shape[1]):  # a reference's control does not rise within a step: that costs little,
            flat = flat and control[0, k] == 0.0  # and it tells the control now
        first, factor, nothing, most = TUNING.damping
        damping, again = 0.0, False
        for _ in range(rounds):
            expected = backward(setup, task, times, course, found[0], points, damping)
            if expected < task.tolerance and not flat:
                break
            flat = False
            better, found = _search(problem, course, trial, points, expected, found)
            if better:
                copy_rows(tried, control)
                copy_rows(other, states)
                damping = 0.0 if damping < nothing else damping / factor
                again = damping > 0.0
                continue
            damping = max(first, factor * damping)
            if damping > most:
                if not again:
                    break
                damping, again = 0.0, False  # steps that were too long where the damping rose may not be so here
        steps, cost, priced, _, sound = found
        backward(setup, task, times, course, steps, points, 0.0)
        return steps, cost, priced, sound

    return optimise
