#include "law_design/law_timing.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <limits>

namespace eampc::law_design {
namespace {

using Clock = std::chrono::steady_clock;
using Point = std::array<double, control::kMaxParameters>;

constexpr std::size_t kLineBytes = 64;
// Points timed together: an interruption by another program spoils one part only.
constexpr std::size_t kFreshPart = 1000;
// Changes no point, but must be waited for.
constexpr double kChainWeight = 1e-200;

double ns_between(Clock::time_point begin, Clock::time_point end) {
  return std::chrono::duration<double, std::nano>(end - begin).count();
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

class Stopwatch {
 public:
  Stopwatch(const control::PackedLaw& law, const LawTimingPlan& plan)
      : law_(law), plan_(plan), n_(static_cast<std::size_t>(law.n_parameters)) {}

  std::size_t rows(std::span<const double> points) const { return points.size() / n_; }

  // Clipped as min of max, which needs no branch: whether u is saturated is hard to foresee.
  double value(const double* p) const {
    const double u = control::evaluate(law_, p).u;
    const double below = u > plan_.u_max ? plan_.u_max : u;
    return below < plan_.u_min ? plan_.u_min : below;
  }

  double sweep_ns(std::span<const double> points) const {
    double sum = 0.0;
    const Clock::time_point begin = Clock::now();
    for (const double* p = points.data(); p != points.data() + points.size(); p += n_) {
      sum += value(p);
    }
    const Clock::time_point end = Clock::now();
    sink_ = sum;
    return ns_between(begin, end) / static_cast<double>(rows(points));
  }

  double chain_ns(std::span<const double> points) const {
    double u = 0.0;
    Point x{};
    const Clock::time_point begin = Clock::now();
    for (const double* p = points.data(); p != points.data() + points.size(); p += n_) {
      std::copy_n(p, n_, x.begin());
      x[0] += kChainWeight * u;
      u = value(x.data());
    }
    const Clock::time_point end = Clock::now();
    sink_ = u;
    return ns_between(begin, end) / static_cast<double>(rows(points));
  }

  // The point itself is at hand, as it is when the estimators have just made it.
  double once_ns(const double* p) const {
    Point x{};
    std::copy_n(p, n_, x.begin());
    const Clock::time_point begin = Clock::now();
    const double u = value(x.data());
    sink_ = u;
    const Clock::time_point end = Clock::now();
    return ns_between(begin, end);
  }

 private:
  const control::PackedLaw& law_;
  const LawTimingPlan& plan_;
  std::size_t n_;
  mutable volatile double sink_ = 0.0;
};

double timer_ns() {
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 100'000; ++i) {
    const Clock::time_point begin = Clock::now();
    least = std::min(least, ns_between(begin, Clock::now()));
  }
  return least;
}

}  // namespace

LawTiming time_law(const control::PackedLaw& law, std::span<const double> points,
                   std::span<const double> fresh, const LawTimingPlan& plan) {
  const Stopwatch watch(law, plan);
  LawTiming timing;
  timing.timer_ns = timer_ns();

  std::vector<double> sweeps, chains;
  for (int i = 0; i < plan.sweeps; ++i) {
    sweeps.push_back(watch.sweep_ns(points));
    chains.push_back(watch.chain_ns(points));
  }
  timing.sweep_ns = median(std::move(sweeps));
  timing.chain_ns = median(std::move(chains));
  const std::size_t n = static_cast<std::size_t>(law.n_parameters);
  std::vector<double> parts;
  for (std::size_t at = 0; at < fresh.size(); at += kFreshPart * n) {
    parts.push_back(watch.sweep_ns(fresh.subspan(at, std::min(fresh.size() - at, kFreshPart * n))));
  }
  timing.fresh_ns = parts.empty() ? 0.0 : median(std::move(parts));

  timing.point_ns.assign(watch.rows(points), std::numeric_limits<double>::infinity());
  for (int i = 0; i < plan.repetitions; ++i) {
    for (std::size_t k = 0; k < timing.point_ns.size(); ++k) {
      timing.point_ns[k] = std::min(timing.point_ns[k], watch.once_ns(points.data() + k * n));
    }
  }

  std::vector<std::byte> other(kColdBytes);
  timing.cold_ns.assign(
      std::min(timing.point_ns.size(), static_cast<std::size_t>(std::max(0, plan.cold_points))),
      std::numeric_limits<double>::infinity());
  for (int i = 0; i < plan.cold_repetitions; ++i) {
    for (std::size_t k = 0; k < timing.cold_ns.size(); ++k) {
      volatile std::byte* line = other.data();
      for (std::size_t at = 0; at < kColdBytes; at += kLineBytes) line[at] = std::byte(k);
      timing.cold_ns[k] = std::min(timing.cold_ns[k], watch.once_ns(points.data() + k * n));
    }
  }
  return timing;
}

}  // namespace eampc::law_design
