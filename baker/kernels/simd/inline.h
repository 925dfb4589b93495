// Forces inlining in inner loops, where the compiler supports it.
#pragma once

#if defined(__GNUC__)
#define ALWAYS_INLINE inline __attribute__((always_inline))
#else
#define ALWAYS_INLINE inline
#endif
