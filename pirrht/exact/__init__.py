"""Solve for psi, v and u* on a grid: the truth that samples are judged against.

It solves the paper's linear equation, 0 = -q psi/lambda + f'psi_x + tr(psi_xx BB')/2 with psi = exp(-phi/lambda) on the
border (section III-A), or its counterpart where a path ends only where a step dt ends (III-B).

* `desirability` is the interface; its table says which module solves for which dynamics;
* `point` (in continuous time), `discrete_point` (with a step) and `car` are such modules: each offers `spacing_for`,
  `grid_of` and a compiled `look`. Another system is one more of them;
* `moving_point` solves for a point among moving obstacles on (x, y, t): `bridges` accounts for walls within a step,
  `march` takes one step back, `moving_look` interpolates between frames;
* `grid` holds what grids share, `optimal` is the optimal law as a policy, `optimal_paths` draws paths under it.

The package is optional: it imports the method, and the method imports nothing of it.
"""
