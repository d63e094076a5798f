"""Controlled systems: dx = f(x) dt + G(x) u dt + B(x) dw, noise and control in one channel (paper, eq. 1).

dynamics           the interface: states by name, drift, blocks G_c and B_c, the Euler-Maruyama step, checks
single_integrator  the point of the paper's first example unicycle           the car of its second double_integrator  a
mass that is pushed by forces, and its best duration between two states rover              two driven wheels: speed and
turn rate second_order_car   a car with inertia

A new system is one file here: it names its states, gives f, G_c and B_c or, where noise enters through its inputs, G
and s, and the velocity command of its robot. It imports `compiled` and plain values (scene, arrays, errors).
"""
