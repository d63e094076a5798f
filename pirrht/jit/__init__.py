"""Kernels: numeric functions as machine code; nothing here knows the method.

jit           kernel, inlined, part, borrowing, jitable; calls and elements by address; threads
vectors       copies, small linear systems, sums of short rows in vector instructions
streams       normal and uniform numbers and crossings of bridges by (seed, sample, draw); single precision
names         a name for all that a kernel computes
cache         kernels on disk by their names
linking       parts stay LLVM IR, entries link them; uses numba's private interface
libraries     the two kinds of code that linking makes; signals wait meanwhile
plain         numba's public interface, for a numba whose private one has changed

With NUMBA_DISABLE_JIT=1 kernels are plain Python. It may import nothing of the package.
"""
