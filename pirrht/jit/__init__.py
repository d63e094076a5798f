"""How numeric functions become kernels; nothing here knows the method.

jit           kernel, inlined, part, borrowing, jitable
linking       what kernels call stays LLVM IR, what Python calls links it; uses numba's private interface
libraries     the two kinds of code that makes
cache         kernels on disk, named by what they compute
disk          where they lie, and who may have written them
addresses     array elements by address, since arrays in records cost reference counts
copies        arrays element by element, since assignments to slices take long to compile
linear        small systems of equations
float32       single precision and its bits, for loops over lanes
streams       normal and uniform numbers by (seed, sample, draw)
threads       independent kernel calls on several threads
unbroken      signals wait while machine code is made or loaded

With NUMBA_DISABLE_JIT=1 kernels are plain Python. It may import nothing of the package.
"""
