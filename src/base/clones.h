// Loops that exist for several processors, chosen when the program is loaded: before ThreadSanitizer has started, which gets the
// plain ones.
#pragma once

#ifdef __SANITIZE_THREAD__
#define FAROL_CLONES
#else
#define FAROL_CLONES __attribute__((target_clones("default", "avx2")))
#endif
