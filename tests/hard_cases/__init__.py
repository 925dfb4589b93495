"""Hard cases: one list of what is hard for the numerics, and what every layer of the project makes of it.

A layer is one implementation of a question: the numpy oracle, its torch twin, the C++ kernels in double and with each
instruction set, OpenGL on llvmpipe and softpipe, the .gsgi file. `over.py`, `surface.py`, `stored.py`, ... each hold
one question with its layers; a layer is added there, in one table. `gaussians.py` and the other groups hold the cases,
and `cases.py` all of them. `./dev hard` prints what each layer makes of each and writes docs/hard-cases.md.
"""
