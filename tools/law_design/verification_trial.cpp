#include "law_design/verification_trial.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "law_design/trial_generator.hpp"

namespace eampc::law_design {
namespace {

// Every fourth plant is a corner of the tolerances: extremes are where the worst cases are.
constexpr std::uint64_t kCornerEvery = 4;
// Above the bandwidth of a pneumatic joint (a few Hz) a sine only tests the clamp.
constexpr double kReferenceFrequencyMax_hz = 2.0;
constexpr double kDisturbanceFrequencyMax_hz = 10.0;
constexpr double kTwoPi = 2.0 * std::numbers::pi;

class PlantFactors {
 public:
  explicit PlantFactors(TrialGenerator& random)
      : random_(random), corner_(random.choice(kCornerEvery) == 0) {}

  double within(double tolerance) {
    const double uniform = random_.uniform(-1.0, 1.0);
    return 1.0 + tolerance * (corner_ ? std::copysign(1.0, uniform) : uniform);
  }

 private:
  TrialGenerator& random_;
  bool corner_;
};

void vary_plant(const PlantTolerances& tolerances, TrialGenerator& random, PlantParameters& plant) {
  PlantFactors factor(random);
  plant.moment_of_inertia_kg_m2 *= factor.within(tolerances.moment_of_inertia);
  const double gain = factor.within(tolerances.control_gain);
  const double stiffness = factor.within(tolerances.stiffness);
  plant.viscous_damping_N_m_s_rad *= factor.within(tolerances.viscous_damping);
  plant.valve_time_constant_s *= factor.within(tolerances.valve_lag);

  const double e0 = plant.initial_contraction_ratio;
  const double k1 = plant.k1_N_per_MPa;
  const double k2 = plant.k2_N_per_MPa;
  const double force = (k1 * e0 + k2) * e0 + plant.k3_N_per_MPa;
  plant.k1_N_per_MPa = gain * k1;
  plant.k2_N_per_MPa = stiffness * (2.0 * k1 * e0 + k2) - 2.0 * plant.k1_N_per_MPa * e0;
  plant.k3_N_per_MPa = gain * force - (plant.k1_N_per_MPa * e0 + plant.k2_N_per_MPa) * e0;
}

TrialDisturbance draw_disturbance(const TrialRanges& ranges, double period_s, double duration_s,
                                  double arming_s, TrialGenerator& random) {
  TrialDisturbance d;
  const double share = random.uniform();  // of both bounds, to the ramp; the rest to the sine
  const double level = share * ranges.disturbance_rad_s2;
  const double rate = share * ranges.disturbance_rate_rad_s3;
  // Arming leads from 0 to d(0): no faster than the bound either.
  const double at_start = std::min(ranges.disturbance_rad_s2,
                                   ranges.disturbance_rate_rad_s3 * std::max(arming_s, period_s));
  d.first_level_rad_s2 = random.uniform(-1.0, 1.0) * std::min(level, share * at_start);
  d.last_level_rad_s2 = random.uniform(-level, level);
  const auto periods = static_cast<std::int64_t>(std::round(duration_s / period_s));
  d.ramp_begin = static_cast<std::int64_t>(random.uniform() * 0.5 * static_cast<double>(periods));
  const double change = std::abs(d.last_level_rad_s2 - d.first_level_rad_s2);
  d.ramp_end = d.ramp_begin + 1;
  if (change > 0.0) {
    d.ramp_end = d.ramp_begin + static_cast<std::int64_t>(std::ceil(change / (rate * period_s)));
  }
  const double rest = std::min((1.0 - share) * ranges.disturbance_rad_s2, (1.0 - share) * at_start);
  d.sine_rad_s2 = random.uniform() * rest;
  const double fastest_hz = d.sine_rad_s2 > 0.0 ? (1.0 - share) * ranges.disturbance_rate_rad_s3 /
                                                      (kTwoPi * d.sine_rad_s2)
                                                : 0.0;
  d.frequency_hz = random.uniform() * std::min(fastest_hz, kDisturbanceFrequencyMax_hz);
  d.phase_rad = random.uniform(0.0, kTwoPi);
  return d;
}

control::ReferenceTrajectory draw_reference(const TrialRanges& ranges, double period_s,
                                            double duration_s, TrialGenerator& random) {
  control::ReferenceTrajectory reference;
  const double first = std::min(ranges.reference_step_rad, ranges.reference_angle_rad);
  reference.offset_rad = random.uniform(-first, first);
  const double below =
      std::max(-ranges.reference_angle_rad, reference.offset_rad - ranges.reference_step_rad);
  const double above =
      std::min(ranges.reference_angle_rad, reference.offset_rad + ranges.reference_step_rad);
  const bool sine = random.choice(2) == 0;
  const double part = random.uniform();
  const double pace = random.uniform();
  if (sine) {
    reference.kind = control::ReferenceKind::kSine;
    reference.amplitude_rad =
        part * std::min(above - reference.offset_rad, reference.offset_rad - below);
    const double fastest_hz = reference.amplitude_rad > 0.0 ? ranges.reference_velocity_rad_s /
                                                                  (kTwoPi * reference.amplitude_rad)
                                                            : 0.0;
    reference.frequency_hz = pace * std::min(fastest_hz, kReferenceFrequencyMax_hz);
  } else {
    reference.kind = control::ReferenceKind::kStep;
    reference.amplitude_rad = below + part * (above - below) - reference.offset_rad;
    // In the first half, on the grid of the periods.
    reference.start_s = period_s * std::floor(pace * 0.5 * duration_s / period_s);
  }
  return reference;
}

}  // namespace

Trial draw_trial(const Campaign& campaign, std::uint64_t index, double period_s, double arming_s) {
  TrialGenerator random(campaign.seed, index);
  const TrialRanges& ranges = campaign.ranges;
  Trial trial;
  trial.plant = campaign.nominal;
  trial.plant.disturbance.clear();
  vary_plant(campaign.tolerances, random, trial.plant);
  trial.plant.initial_angle_rad += random.uniform(-1.0, 1.0) * ranges.start_angle_rad;
  trial.plant.initial_velocity_rad_s += random.uniform(-1.0, 1.0) * ranges.start_velocity_rad_s;
  trial.plant.encoder_noise_rad = random.uniform() * ranges.encoder_noise_rad;
  trial.plant.velocity_noise_rad_s = random.uniform() * ranges.velocity_noise_rad_s;
  trial.disturbance = draw_disturbance(ranges, period_s, campaign.duration_s, arming_s, random);
  trial.reference = draw_reference(ranges, period_s, campaign.duration_s, random);
  return trial;
}

}  // namespace eampc::law_design
