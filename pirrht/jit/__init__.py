"""Kernels: numeric functions as machine code; nothing here knows the method.

jit           kernel, inlined, part, borrowing, jitable; calls and elements by address; threads
vectors       copies, sums and small linear systems of short rows
records       numbers and addresses of arrays for kernels, and the same without addresses
streams       normal and uniform numbers and crossings of bridges by (seed, sample, draw); single precision
cache         kernels on disk, each under a name of all that it computes
ownership     folders that only this user may write to
linking       parts stay LLVM IR, entries link them; uses numba's private interface
patches       signals wait for LLVM; names of code, types of operations, no collection of garbage

With NUMBA_DISABLE_JIT=1 kernels are plain Python. It may import nothing of the package.
"""
