"""Solve for psi, v and u* on a grid: the truth that samples are judged against.

It solves the paper's linear equation, 0 = -q psi/lambda + f'psi_x + tr(psi_xx BB')/2 with psi = exp(-phi/lambda) on the
border (section III-A), or its counterpart where a path ends only where a step dt ends (III-B).

* `desirability` is the interface: its table says which module solves for which dynamics; `Optimal` is its policy, and
  paths are drawn under its law;
* `point` (in continuous time), `discrete_point` (with a step), `moving_point` (on x, y and t) and `car` are such
  modules: each offers `spacing_for`, `grid_of` and a compiled `evaluate`. Another system is one more of them;
* `boundaries` takes one step back in time among the goal, walls and border within reach of it;
* `grid` holds what grids share and the numbers that tune them.

The package is optional: it imports the method, and the method imports nothing of it.
"""
