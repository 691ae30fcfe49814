// Python binding of the Monte-Carlo verification: a campaign, a range of its trials → columns, and
// one trial replayed cycle by cycle.
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>

#include <cmath>
#include <optional>

#include "law_design/bind_cycles.hpp"
#include "law_design/bind_plant.hpp"
#include "law_design/closed_loop_simulation.hpp"
#include "law_design/numpy_column.hpp"
#include "law_design/verification_campaign.hpp"
#include "service/law_file.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace eampc::law_design {
namespace {

constexpr double kLongest_s = 3600.0;

void require_sound(const Campaign& campaign) {
  const PlantTolerances& t = campaign.tolerances;
  for (const double ratio :
       {t.moment_of_inertia, t.control_gain, t.stiffness, t.viscous_damping, t.valve_lag}) {
    if (!(ratio >= 0.0 && ratio < 1.0)) {
      throw nb::value_error("a tolerance must be at least 0 and below 1 (100 %)");
    }
  }
  const TrialRanges& r = campaign.ranges;
  for (const double range :
       {r.disturbance_rad_s2, r.disturbance_rate_rad_s3, r.start_angle_rad, r.start_velocity_rad_s,
        r.reference_angle_rad, r.reference_step_rad, r.reference_velocity_rad_s,
        r.encoder_noise_rad, r.velocity_noise_rad_s}) {
    if (!(range >= 0.0) || !std::isfinite(range)) {
      throw nb::value_error("a range must be finite and not negative");
    }
  }
  if (!(campaign.duration_s > 0.0 && campaign.duration_s <= kLongest_s)) {
    throw nb::value_error("duration_s must be above 0 and at most 3600");
  }
}

template <typename T, typename Member>
void column(nb::dict& out, const char* name, const std::vector<TrialOutcome>& rows,
            Member TrialOutcome::*member) {
  std::vector<T> values;
  values.reserve(rows.size());
  for (const TrialOutcome& row : rows) values.push_back(static_cast<T>(row.*member));
  out[name] = numpy_column(std::move(values));
}

nb::dict outcome_columns(const std::vector<TrialOutcome>& rows) {
  nb::dict out;
  const auto number = [&](const char* name, double TrialOutcome::*member) {
    column<double>(out, name, rows, member);
  };
  const auto count = [&](const char* name, std::int64_t TrialOutcome::*member) {
    column<std::int64_t>(out, name, rows, member);
  };
  column<std::int64_t>(out, "index", rows, &TrialOutcome::index);
  number("angle_rad", &TrialOutcome::angle_rad);
  number("velocity_rad_s", &TrialOutcome::velocity_rad_s);
  number("tracking_error_rad", &TrialOutcome::tracking_error_rad);
  number("rms_error_rad", &TrialOutcome::rms_error_rad);
  count("angle_violations", &TrialOutcome::angle_violations);
  count("velocity_violations", &TrialOutcome::velocity_violations);
  count("range_violations", &TrialOutcome::range_violations);
  count("slew_violations", &TrialOutcome::slew_violations);
  count("non_finite", &TrialOutcome::non_finite);
  count("outside_box", &TrialOutcome::outside_box);
  count("saturated", &TrialOutcome::saturated);
  count("fault", &TrialOutcome::fault);
  count("closed_loop_cycles", &TrialOutcome::closed_loop_cycles);
  count("cycles", &TrialOutcome::cycles);
  return out;
}

nb::tuple run_bound(const service::LawFile& law, const Campaign& campaign, std::uint64_t first,
                    int count, int threads, const nb::object& progress) {
  require_sound(campaign);
  if (count < 0 || threads < 0) {
    throw nb::value_error("count and threads must not be negative");
  }
  CampaignRun run;
  {
    const nb::gil_scoped_release released;
    run = run_campaign(law.config(), campaign, first, count, threads, [&](int done, int) {
      const nb::gil_scoped_acquire acquired;
      if (PyErr_CheckSignals() != 0) throw nb::python_error();
      if (!progress.is_none()) progress(done);
      return true;
    });
  }
  return nb::make_tuple(outcome_columns(run.outcomes), run.thread_seconds);
}

nb::tuple replay_bound(const service::LawFile& law, const Campaign& campaign, std::uint64_t index) {
  require_sound(campaign);
  std::vector<SimulatedCycle> cycles;
  TrialOutcome outcome;
  {
    const nb::gil_scoped_release released;
    outcome = run_trial(law.config(), campaign, index, &cycles);
  }
  return nb::make_tuple(outcome_columns({outcome}), cycle_columns(cycles));
}

nb::dict trial_bound(const service::LawFile& law, const Campaign& campaign, std::uint64_t index) {
  require_sound(campaign);
  const control::ControllerConfig& config = law.config();
  const Trial trial = draw_trial(campaign, index, config.model.period_s,
                                 lead_cycles(config, 0) * config.model.period_s);
  const PlantParameters& p = trial.plant;
  nb::dict plant;
  plant["moment_of_inertia_kg_m2"] = p.moment_of_inertia_kg_m2;
  plant["viscous_damping_N_m_s_rad"] = p.viscous_damping_N_m_s_rad;
  plant["k1_N_per_MPa"] = p.k1_N_per_MPa;
  plant["k2_N_per_MPa"] = p.k2_N_per_MPa;
  plant["k3_N_per_MPa"] = p.k3_N_per_MPa;
  plant["valve_time_constant_s"] = p.valve_time_constant_s;
  plant["initial_angle_rad"] = p.initial_angle_rad;
  plant["initial_velocity_rad_s"] = p.initial_velocity_rad_s;
  plant["encoder_noise_rad"] = p.encoder_noise_rad;
  plant["velocity_noise_rad_s"] = p.velocity_noise_rad_s;
  const TrialDisturbance& d = trial.disturbance;
  const double T = config.model.period_s;
  nb::dict disturbance;
  disturbance["first_level_rad_s2"] = d.first_level_rad_s2;
  disturbance["last_level_rad_s2"] = d.last_level_rad_s2;
  disturbance["ramp_begin_s"] = T * static_cast<double>(d.ramp_begin);
  disturbance["ramp_end_s"] = T * static_cast<double>(d.ramp_end);
  disturbance["sine_rad_s2"] = d.sine_rad_s2;
  disturbance["frequency_hz"] = d.frequency_hz;
  disturbance["phase_rad"] = d.phase_rad;
  const control::ReferenceTrajectory& r = trial.reference;
  nb::dict reference;
  reference["kind"] = r.kind == control::ReferenceKind::kSine ? "sine" : "step";
  reference["offset_rad"] = r.offset_rad;
  reference["amplitude_rad"] = r.amplitude_rad;
  reference["start_s"] = r.start_s;
  reference["frequency_hz"] = r.frequency_hz;
  nb::dict out;
  out["plant"] = plant;
  out["disturbance"] = disturbance;
  out["reference"] = reference;
  return out;
}

}  // namespace

void bind_verification(nb::module_& m) {
  nb::class_<PlantTolerances>(m, "PlantTolerances", "Half-widths as ratios: 0.2 is ±20 %.")
      .def(nb::init<>())
      .def_rw("moment_of_inertia", &PlantTolerances::moment_of_inertia)
      .def_rw("control_gain", &PlantTolerances::control_gain)
      .def_rw("stiffness", &PlantTolerances::stiffness)
      .def_rw("viscous_damping", &PlantTolerances::viscous_damping)
      .def_rw("valve_lag", &PlantTolerances::valve_lag);
  nb::class_<TrialRanges>(m, "TrialRanges",
                          "Half-widths about zero, but the start's, about the rig's initial state.")
      .def(nb::init<>())
      .def_rw("disturbance_rad_s2", &TrialRanges::disturbance_rad_s2)
      .def_rw("disturbance_rate_rad_s3", &TrialRanges::disturbance_rate_rad_s3)
      .def_rw("start_angle_rad", &TrialRanges::start_angle_rad)
      .def_rw("start_velocity_rad_s", &TrialRanges::start_velocity_rad_s)
      .def_rw("reference_angle_rad", &TrialRanges::reference_angle_rad)
      .def_rw("reference_step_rad", &TrialRanges::reference_step_rad)
      .def_rw("reference_velocity_rad_s", &TrialRanges::reference_velocity_rad_s)
      .def_rw("encoder_noise_rad", &TrialRanges::encoder_noise_rad)
      .def_rw("velocity_noise_rad_s", &TrialRanges::velocity_noise_rad_s);
  nb::class_<Campaign>(m, "Campaign", "What the trials of one Monte-Carlo campaign have in common.")
      .def(
          "__init__",
          [](Campaign* self, const nb::dict& plant) {
            new (self) Campaign{};
            self->nominal = plant_of(plant, {});
          },
          "plant"_a, "plant: the nominal one, numbers as `simulate` takes them.")
      .def_rw("tolerances", &Campaign::tolerances)
      .def_rw("ranges", &Campaign::ranges)
      .def_rw("angle_bound_rad", &Campaign::angle_bound_rad)
      .def_rw("velocity_bound_rad_s", &Campaign::velocity_bound_rad_s)
      .def_rw("duration_s", &Campaign::duration_s)
      .def_rw("seed", &Campaign::seed);

  m.def("run_campaign", &run_bound, "law"_a, "campaign"_a, "first"_a, "count"_a, "threads"_a = 0,
        "progress"_a = nb::none(),
        "Trials first .. first + count - 1 of a campaign: (columns, seconds).\n\n"
        "columns: dict of arrays, (count,), one entry per trial in the order of the indices; each "
        "depends on campaign\n"
        "and index alone. seconds: processor time of all threads together. threads 0: one per "
        "core. progress: called\n"
        "with the number of trials done, some ten times a second; an exception in it, or Ctrl-C, "
        "ends the campaign.\n"
        "The GIL is released. ValueError: a tolerance, range or duration that makes no sense.");
  m.def("replay_trial", &replay_bound, "law"_a, "campaign"_a, "index"_a,
        "One trial again, bit for bit: (columns with one entry, dict of arrays per cycle as from "
        "`simulate`).");
  m.def("trial_of", &trial_bound, "law"_a, "campaign"_a, "index"_a,
        "What trial `index` draws: dict of plant, disturbance and reference, each a dict of "
        "numbers.");
}

}  // namespace eampc::law_design
