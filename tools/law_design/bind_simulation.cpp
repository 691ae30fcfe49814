// Python binding of the simulated closed loop: law + plant + scenario → columns.
#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <set>

#include "law_design/bind_reference.hpp"
#include "law_design/closed_loop_simulation.hpp"
#include "law_design/numpy_column.hpp"
#include "service/law_file.hpp"

namespace nb = nanobind;
using namespace nb::literals;

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

template <typename T, typename Read>
nb::object column(const std::vector<SimulatedCycle>& rows, Read read) {
  std::vector<T> values;
  values.reserve(rows.size());
  for (const SimulatedCycle& row : rows) {
    values.push_back(static_cast<T>(read(row)));
  }
  return numpy_column(std::move(values));
}

nb::dict columns(const std::vector<SimulatedCycle>& rows) {
  constexpr double kPa_per_MPa = 1000.0;
  using Row = const SimulatedCycle&;
  nb::dict out;
  const auto number = [&](const char* name, auto read) { out[name] = column<double>(rows, read); };
  const auto integer = [&](const char* name, auto read) {
    out[name] = column<std::int64_t>(rows, read);
  };
  integer("cycle", [](Row r) { return r.record.cycle; });
  number("scenario_time_s", [](Row r) { return r.time_s; });
  number("reference_angle_rad", [](Row r) { return r.record.reference.angle_rad; });
  number("reference_velocity_rad_s", [](Row r) { return r.record.reference.velocity_rad_s; });
  number("measured_angle_rad", [](Row r) { return r.record.sample.angle_rad; });
  number("angle_rad", [](Row r) { return r.record.state.x[0]; });
  number("velocity_rad_s", [](Row r) { return r.record.state.x[1]; });
  number("valve_control", [](Row r) { return r.record.state.x[2]; });
  number("disturbance_rad_s2", [](Row r) { return r.record.disturbance.for_law[1]; });
  number("control", [](Row r) { return r.record.law.u; });
  number("u1_V", [](Row r) { return r.record.valves.u1_V; });
  number("u2_V", [](Row r) { return r.record.valves.u2_V; });
  integer("region", [](Row r) { return r.record.law.region; });
  integer("mode", [](Row r) { return static_cast<int>(r.record.mode); });
  integer("fault", [](Row r) { return static_cast<int>(r.record.fault); });
  integer("limits", [](Row r) { return r.record.limits; });
  number("true_angle_rad", [](Row r) { return r.truth.angle_rad; });
  number("true_velocity_rad_s", [](Row r) { return r.truth.velocity_rad_s; });
  number("true_disturbance_rad_s2", [](Row r) { return r.disturbance_rad_s2; });
  number("true_torque_N_m", [](Row r) { return r.torque_N_m; });
  number("pressure1_kPa", [](Row r) { return kPa_per_MPa * r.truth.pressure1_MPa; });
  number("pressure2_kPa", [](Row r) { return kPa_per_MPa * r.truth.pressure2_MPa; });
  return out;
}

nb::dict simulate_bound(const service::LawFile& law, const nb::dict& plant,
                        const std::vector<nb::dict>& disturbance, double duration_s,
                        const std::string& kind, double amplitude_rad, double offset_rad,
                        double start_s, double frequency_hz, std::optional<RowArray> table,
                        double sample_period_s, int arm_at_cycle) {
  const PlantParameters parameters = plant_of(plant, disturbance);
  std::vector<control::Reference> rows;
  RunPlan plan;
  plan.duration_s = duration_s;
  plan.arm_at_cycle = arm_at_cycle;
  plan.reference = reference_trajectory(
      {kind, amplitude_rad, offset_rad, start_s, frequency_hz, std::move(table), sample_period_s},
      rows);
  if (!(duration_s > 0.0) || arm_at_cycle < 0) {
    throw nb::value_error("duration_s must be positive and arm_at_cycle not negative");
  }
  std::vector<SimulatedCycle> cycles;
  {
    const nb::gil_scoped_release released;
    cycles = simulate(law.config(), parameters, plan);
  }
  return columns(cycles);
}

}  // namespace

void bind_simulation(nb::module_& m) {
  m.def("simulate", &simulate_bound, "law"_a, "plant"_a, "disturbance"_a, "duration_s"_a,
        "kind"_a = "constant", "amplitude_rad"_a = 0.0, "offset_rad"_a = 0.0, "start_s"_a = 0.0,
        "frequency_hz"_a = 0.0, "table"_a = nb::none(), "sample_period_s"_a = 0.0,
        "arm_at_cycle"_a = 20,
        "The daemon's control cycle against the nonlinear joint, in one process.\n\n"
        "law: Law. plant: dict of the numbers of [joint], [muscle], [valve] and [emulator] with "
        "their rig-file names.\n"
        "disturbance: list of dicts as in the rig file. kind .. sample_period_s: the reference.\n"
        "Returns a dict of arrays, one entry per cycle from the first frame on; scenario_time_s is "
        "negative before\n"
        "ACTIVE. Columns without `true_` are what the daemon records. mode, fault: numbers of the "
        "enumerations.\n"
        "The GIL is released. ValueError: a key that is missing, unknown or out of range.");
}

}  // namespace eampc::law_design
