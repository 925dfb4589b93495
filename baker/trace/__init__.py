"""B, the demodulated indirect light, at points: Mitsuba's rays and Dr.Jit kernels of our own."""
