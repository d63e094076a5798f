"""Controlled systems: dx = f(x) dt + G(x) u dt + B(x) dw, noise and control in one channel (paper, eq. 1).

`dynamics` is the interface: states by name, drift, blocks G_c and B_c, the Euler-Maruyama step, angles to turn by.
One file each its members: `single_integrator` and `unicycle` are the paper's examples, `double_integrator` a mass that
is pushed by forces, `rover` has two driven wheels, `second_order_car` inertia.

A new system is one file here: it names its states, gives f, G_c and B_c or, where noise enters through its inputs, G
and s, and the velocity command of its robot. It imports `jit` and plain values (scene, arrays, errors).
"""
