"""What moves: dx = f(x) dt + G(x) u dt + B(x) dw, noise and control in one channel (paper, eq. 1).

dynamics           the interface: states by name, drift, blocks G_c and B_c, the Euler-Maruyama step, what is refused
single_integrator  the point of the paper's first example
unicycle           the car of its second
double_integrator  a mass that is pushed by forces; `best_duration` says how long it takes best

A new system is one file here: it names its states, gives f, G_c and B_c or, where noise enters through its inputs, G
and s, and says what velocity its robot is commanded. It may import `compiled` and plain values (scene, arrays, errors);
`problem` adds costs and a scene to it.
"""
