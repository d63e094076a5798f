"""Solve for psi, v and u* on a grid: the truth that samples are judged against.

It solves the paper's linear equation, 0 = -q psi/lambda + f'psi_x + tr(psi_xx BB')/2 with psi = exp(-phi/lambda) on the
border (section III-A), or its counterpart where a path ends only where a step dt ends (III-B).

* `desirability` is the interface; its table says which module solves for which dynamics;
* `planar` (a point in continuous time), `discrete_time` (a point with a step) and `heading_grid` (a car) are such
  modules: each offers `spacing_for`, `grid_of` and a compiled `look`. Another system is one more of them;
* `moving` solves for a point among moving obstacles on (x, y, t): `bridges` accounts for walls within a step, `march`
  takes one step back, `moving_look` interpolates between frames;
* `mass_on_line` solves for a mass on a line, which needs a grid of two dimensions instead of four;
* `domain` holds what grids share, `optimal_paths` draws paths under the optimal law.

It imports geometry, topology, systems, problem, freespace and the first exits of rollouts.
"""
