"""How numeric functions become kernels; nothing here knows the method.

jit           kernel, inlined, jitable; their folder on disk, named after all sources of the package
disk          what lies there: checked before it is used, replaced as a whole
addresses     array elements by address, since arrays in records cost reference counts
float32       single precision and its bits, for loops over lanes
streams       normal and uniform numbers by (seed, sample, draw)
threads       independent kernel calls on several threads

With NUMBA_DISABLE_JIT=1 kernels are plain Python. It may import nothing of the package.
"""
