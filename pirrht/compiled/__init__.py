"""How numeric functions become kernels; nothing here knows the method.

jit           kernel, inlined, part, jitable; their folder on disk, named after all sources of the package
identity      what a function computes, as a name by which all processes find it on disk
symbols       names of machine code that no other process gives to other code
alone         one process compiles what several want
disk          what lies there: checked before it is used, replaced as a whole
addresses     array elements by address, since arrays in records cost reference counts
copies        arrays element by element, since assignments to slices take long to compile
linear        small systems of equations
float32       single precision and its bits, for loops over lanes
streams       normal and uniform numbers by (seed, sample, draw)
threads       independent kernel calls on several threads
unbroken      signals wait while machine code is made or loaded

With NUMBA_DISABLE_JIT=1 kernels are plain Python. It may import nothing of the package.
"""
