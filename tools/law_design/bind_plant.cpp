#include "law_design/bind_plant.hpp"

#include <nanobind/stl/string.h>

#include <set>
#include <string>

namespace nb = nanobind;

namespace eampc::law_design {
namespace {

// Reads a dict key by key and refuses what nobody asked for: a misspelt key must not become a
// default.
class DictReader {
 public:
  DictReader(const nb::dict& dict, const char* name) : dict_(dict), name_(name) {}

  template <typename T>
  T at(const char* key) {
    if (!dict_.contains(key)) {
      throw nb::value_error((name_ + " lacks " + key).c_str());
    }
    return read<T>(key);
  }

  template <typename T>
  T get(const char* key, T fallback) {
    return dict_.contains(key) ? read<T>(key) : fallback;
  }

  void finish() const {
    for (const auto& [key, value] : dict_) {
      const std::string text = nb::cast<std::string>(key);
      if (!seen_.contains(text)) {
        throw nb::value_error((name_ + " has no key " + text).c_str());
      }
    }
  }

 private:
  template <typename T>
  T read(const char* key) {
    seen_.insert(key);
    try {
      return nb::cast<T>(dict_[key]);
    } catch (const nb::cast_error&) {
      throw nb::value_error((name_ + "." + key + " has the wrong type").c_str());
    }
  }

  nb::dict dict_;
  std::string name_;
  std::set<std::string> seen_;
};

DisturbanceTerm term_of(const nb::dict& dict) {
  DictReader reader(dict, "disturbance term");
  DisturbanceTerm term;
  const auto kind = reader.at<std::string>("kind");
  term.amplitude_rad_s2 = reader.at<double>("amplitude_rad_s2");
  if (kind == "constant") {
    term.kind = DisturbanceKind::kConstant;
  } else if (kind == "step") {
    term.kind = DisturbanceKind::kStep;
    term.start_s = reader.get<double>("start_s", 0.0);
  } else if (kind == "sine") {
    term.kind = DisturbanceKind::kSine;
    term.frequency_hz = reader.at<double>("frequency_hz");
  } else if (kind == "sine_of_state_sum") {
    term.kind = DisturbanceKind::kSineOfStateSum;
  } else if (kind == "cosine_of_state_sum") {
    term.kind = DisturbanceKind::kCosineOfStateSum;
  } else if (kind == "pulse") {
    term.kind = DisturbanceKind::kPulse;
    term.start_s = reader.at<double>("start_s");
    term.end_s = reader.at<double>("end_s");
  } else {
    throw nb::value_error(("disturbance kind " + kind + " is unknown").c_str());
  }
  reader.finish();
  return term;
}

}  // namespace

PlantParameters plant_of(const nb::dict& dict, const std::vector<nb::dict>& disturbance) {
  DictReader reader(dict, "plant");
  PlantParameters plant;
  plant.moment_of_inertia_kg_m2 = reader.at<double>("moment_of_inertia_kg_m2");
  plant.viscous_damping_N_m_s_rad = reader.at<double>("viscous_damping_N_m_s_rad");
  plant.gear_radius_m = reader.at<double>("gear_radius_m");
  plant.k1_N_per_MPa = reader.at<double>("k1_N_per_MPa");
  plant.k2_N_per_MPa = reader.at<double>("k2_N_per_MPa");
  plant.k3_N_per_MPa = reader.at<double>("k3_N_per_MPa");
  plant.k4_N = reader.get<double>("k4_N", 0.0);
  plant.initial_contraction_ratio = reader.at<double>("initial_contraction_ratio");
  plant.initial_length_m = reader.at<double>("initial_length_m");
  plant.pressure_gain_MPa_per_V = reader.at<double>("pressure_gain_MPa_per_V");
  plant.min_V = reader.at<double>("min_V");
  plant.max_V = reader.at<double>("max_V");
  plant.safe_V = reader.at<double>("safe_V");
  plant.valve_time_constant_s = reader.get<double>("valve_time_constant_s", 0.0);
  plant.initial_angle_rad = reader.get<double>("initial_angle_rad", 0.0);
  plant.initial_velocity_rad_s = reader.get<double>("initial_velocity_rad_s", 0.0);
  plant.hold_until_start = reader.get<bool>("hold_until_start", false);
  plant.substeps = reader.get<int>("substeps", 10);
  plant.encoder_noise_rad = reader.get<double>("encoder_noise_rad", 0.0);
  plant.velocity_noise_rad_s = reader.get<double>("velocity_noise_rad_s", 0.0);
  plant.seed = reader.get<std::uint64_t>("seed", 1);
  reader.finish();
  if (!(plant.moment_of_inertia_kg_m2 > 0.0) || !(plant.initial_length_m > 0.0) ||
      plant.substeps < 1 || !(plant.min_V < plant.max_V)) {
    throw nb::value_error(
        "plant: inertia and length must be positive, substeps at least 1, min_V below max_V");
  }
  for (const nb::dict& term : disturbance) {
    plant.disturbance.push_back(term_of(term));
  }
  return plant;
}

}  // namespace eampc::law_design
