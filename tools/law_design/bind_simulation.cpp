// Python binding of the simulated closed loop: law + plant + scenario → columns.
#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "law_design/bind_cycles.hpp"
#include "law_design/bind_plant.hpp"
#include "law_design/bind_reference.hpp"
#include "law_design/closed_loop_simulation.hpp"
#include "law_design/numpy_column.hpp"
#include "service/law_file.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace eampc::law_design {
namespace {

template <typename T, typename Read>
nb::object column(const std::vector<SimulatedCycle>& rows, Read read) {
  std::vector<T> values;
  values.reserve(rows.size());
  for (const SimulatedCycle& row : rows) {
    values.push_back(static_cast<T>(read(row)));
  }
  return numpy_column(std::move(values));
}

}  // namespace

nb::dict cycle_columns(const std::vector<SimulatedCycle>& rows) {
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

namespace {

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
  return cycle_columns(cycles);
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
