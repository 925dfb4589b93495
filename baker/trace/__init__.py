"""B, the demodulated indirect light, at points: ray casting by Mitsuba and our own Dr.Jit kernels."""
