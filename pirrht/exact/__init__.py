"""The truth on a grid: psi, v and u* of a problem solved for instead of sampled, which samples are judged against.

Solved is the linear equation of the paper, 0 = -q psi/lambda + f'psi_x + tr(psi_xx BB')/2 with psi = exp(-phi/lambda)
on the border (section III-A), or its counterpart where a path ends only where a step dt ends (III-B).

* `desirability` is what others ask; its table says which module solves for which dynamics;
* `planar` (a point in continuous time), `discrete_time` (a point with a step, on `tiles`) and `heading_grid` (a car)
  are such modules: each offers `spacing_for`, `grid_of` and a compiled `look`. Another system is one more of them;
* `moving` solves for a point among bodies that move, on (x, y, t): `timetable` says when steps end, `bridges` and
  `payoffs` what walls do to the paths of a step, `march` takes one step back, `moving_look` says what lies between
  frames, and `moving_paths` draws paths under its law;
* `mass_on_line` is the truth for a mass, whose plane would need a grid of four dimensions: on a line it needs two;
* `domain` and `lagrange` hold what they share, `optimal_paths` draws paths under the law that was found.

It may import geometry, topology, systems, problem, freespace and the first exits of rollouts; it alone knows SciPy.
"""
