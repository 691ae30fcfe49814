// The random numbers of one trial. In: campaign seed, trial index → out: a stream of its own, so
// that a trial is drawn and replayed without the ones before it.
// SplitMix64 (Steele, Lea, Flood 2014): a 64-bit counter through a mixing function; no state but
// the counter, so neither threads nor machines share anything.
#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>

namespace eampc::law_design {

class TrialGenerator {
 public:
  TrialGenerator(std::uint64_t seed, std::uint64_t index)
      : counter_(mixed(mixed(seed + kGolden) ^ mixed(index * kGolden + 1))) {}

  // In [0, 1): 53 bits.
  double uniform() { return static_cast<double>(next() >> 11) * 0x1p-53; }
  double uniform(double lower, double upper) { return lower + (upper - lower) * uniform(); }
  // One of 0 .. choices − 1; `choices` is small, so the remainder's bias of 2⁻⁶⁰ does not matter.
  std::uint64_t choice(std::uint64_t choices) { return next() % choices; }

  // Two independent standard normal numbers (Box–Muller).
  struct Pair {
    double first, second;
  };
  Pair normal_pair() {
    const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform()));
    const double turn = 2.0 * std::numbers::pi * uniform();
    return {radius * std::cos(turn), radius * std::sin(turn)};
  }

 private:
  static constexpr std::uint64_t kGolden = 0x9E3779B97F4A7C15u;  // 2⁶⁴ over the golden ratio

  static std::uint64_t mixed(std::uint64_t z) {
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return z ^ (z >> 31);
  }
  std::uint64_t next() { return mixed(counter_ += kGolden); }

  std::uint64_t counter_;
};

}  // namespace eampc::law_design
