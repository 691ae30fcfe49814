// EAMPC_NONBLOCKING marks where the real-time path begins: a function that never takes memory,
// locks, throws or waits. clang proves it of everything such a function calls (-Wfunction-effects,
// tests/realtime_proof) and RealtimeSanitizer watches it run; other compilers read nothing.
#pragma once

#if defined(__clang__) && __clang_major__ >= 20
#define EAMPC_NONBLOCKING [[clang::nonblocking]]
#else
#define EAMPC_NONBLOCKING
#endif
