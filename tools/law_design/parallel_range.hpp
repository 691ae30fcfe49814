// A loop over both cores whose result does not depend on how many threads there are: each index
// writes only what is its own, and the caller adds up in order.
#pragma once

#include <functional>

namespace eampc::law_design {

/// Says how far a loop has come, from the calling thread only; false cancels.
using LoopProgress = std::function<bool(int done, int of)>;

/// Calls work(index, thread) for every index of [0, count), thread < threads. Indices are handed
/// out in order, in blocks. Throws Cancelled if `progress` returned false, and the first exception
/// of `work`, when every thread has stopped.
void parallel_range(int count, int threads, const std::function<void(int, int)>& work,
                    const LoopProgress& progress = {});

/// `wanted`, or as many as this machine runs at once if it is 0.
int thread_count(int wanted);

}  // namespace eampc::law_design
