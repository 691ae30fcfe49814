// Python binding of what compares another controller with the daemon's control cycle: the same
// simulated joint behind the same frames, and the cycle's own time.
#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <memory>

#include "control/encoder_codec.hpp"
#include "control/valve_codec.hpp"
#include "law_design/bind_plant.hpp"
#include "law_design/bind_reference.hpp"
#include "law_design/step_timing.hpp"
#include "service/law_file.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace eampc::law_design {
namespace {

// The joint on the bus of a law's rig: what is measured and commanded passes through its frames.
class JointOnBus {
 public:
  JointOnBus(std::shared_ptr<const service::LawFile> law, const PlantParameters& plant)
      : law_(std::move(law)),
        period_s_(law_->config().model.period_s),
        joint_(plant, period_s_),
        encoder_(law_->config().encoder),
        valves_(law_->config().valve_command) {}

  nb::tuple measure() {
    const control::Frame frame = joint_.encoder_frame(law_->config().encoder);
    const control::EncoderSample sample = encoder_.decode(&frame);
    return nb::make_tuple(sample.angle_rad, sample.velocity_rad_s);
  }

  nb::tuple advance(double u1_V, double u2_V) {
    const auto& limits = law_->config().valve;
    const control::VoltageWindow window{limits.min_V, limits.max_V};
    const control::EncodedCommand command = valves_.encode({{u1_V, u2_V, true}, window, window});
    joint_.advance(law_->config().valve_command, command.frame, time_s());
    ++cycle_;
    return nb::make_tuple(command.sent.u1_V, command.sent.u2_V);
  }

  double time_s() const { return static_cast<double>(cycle_) * period_s_; }
  double angle_rad() const { return joint_.state().angle_rad; }
  double velocity_rad_s() const { return joint_.state().velocity_rad_s; }
  double disturbance_rad_s2() const { return joint_.disturbance_rad_s2(time_s()); }

 private:
  std::shared_ptr<const service::LawFile> law_;
  double period_s_;
  SimulatedJoint joint_;
  control::EncoderCodec encoder_;
  control::ValveCodec valves_;
  std::int64_t cycle_ = 0;
};

nb::dict time_steps_bound(const service::LawFile& law, const nb::dict& plant,
                          const std::vector<nb::dict>& disturbance, double duration_s,
                          double reference_rad, int arm_at_cycle) {
  if (!(duration_s > 0.0) || arm_at_cycle < 0) {
    throw nb::value_error("duration_s must be positive and arm_at_cycle not negative");
  }
  const PlantParameters parameters = plant_of(plant, disturbance);
  std::vector<control::Reference> rows;
  RunPlan plan;
  plan.duration_s = duration_s;
  plan.arm_at_cycle = arm_at_cycle;
  plan.reference =
      reference_trajectory({"constant", reference_rad, 0.0, 0.0, 0.0, std::nullopt, 0.0}, rows);
  ControllerTiming timing;
  {
    const nb::gil_scoped_release released;
    timing = time_steps(law.config(), parameters, plan);
  }
  nb::dict out;
  out["estimators_and_law_s"] = timing.estimators_and_law_s;
  out["control_cycle_s"] = timing.control_cycle_s;
  return out;
}

}  // namespace

void bind_step_timing(nb::module_& m) {
  nb::class_<JointOnBus>(m, "JointOnBus",
                         "The simulated joint behind the encoder and valve frames of a law's rig.")
      .def(
          "__init__",
          // The law object is kept alive by this one; its configuration is referred to, not copied.
          [](JointOnBus* self, service::LawFile& law, const nb::dict& plant,
             const std::vector<nb::dict>& disturbance) {
            new (self) JointOnBus(
                std::shared_ptr<const service::LawFile>(&law, [](const service::LawFile*) {}),
                plant_of(plant, disturbance));
          },
          "law"_a, "plant"_a, "disturbance"_a, nb::keep_alive<1, 2>())
      .def("measure", &JointOnBus::measure,
           "One encoder frame: (angle rad, velocity rad/s) as they stand in it.")
      .def("advance", &JointOnBus::advance, "u1_V"_a, "u2_V"_a,
           "One period with these voltages: they are clamped to the valves' range and rounded to "
           "the frame's resolution. Returns what stands in the frame.")
      .def_prop_ro("time_s", &JointOnBus::time_s)
      .def_prop_ro("angle_rad", &JointOnBus::angle_rad)
      .def_prop_ro("velocity_rad_s", &JointOnBus::velocity_rad_s)
      .def_prop_ro("disturbance_rad_s2", &JointOnBus::disturbance_rad_s2);
  m.def("time_steps", &time_steps_bound, "law"_a, "plant"_a, "disturbance"_a, "duration_s"_a,
        "reference_rad"_a, "arm_at_cycle"_a = 20,
        "Processor time of the daemon's controller over the scenario's cycles of a simulated run "
        "under a constant reference.\n\n"
        "Returns estimators_and_law_s (sample to u) and control_cycle_s (frame decoded, "
        "estimators, law, safety, frame encoded). The GIL is released.");
}

}  // namespace eampc::law_design
