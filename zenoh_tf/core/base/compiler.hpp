// Function attributes that depend on the compiler and the processor.
//
// Thread safety: macros only.
#pragma once

// For functions whose call would cost as much as their work. Also for those that a caller with
// ZTF_MULTIVERSION must inline, so that they are compiled for the same processor as the caller.
#define ZTF_ALWAYS_INLINE [[gnu::always_inline]] inline

// For functions that are mostly arithmetic. The compiler also makes a version for processors with
// fused multiply-add and 256-bit vectors, and the loader picks one. GCC knows the name x86-64-v3
// since version 12.
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__) && \
    __GNUC__ >= 12 && !defined(__SANITIZE_THREAD__) && !defined(__SANITIZE_ADDRESS__)
#define ZTF_MULTIVERSION __attribute__((target_clones("default", "arch=x86-64-v3")))
#else
#define ZTF_MULTIVERSION
#endif
