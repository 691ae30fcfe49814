// Python binding of model, sampling, tightening, estimator numbers and the condensed problems.
#include <nanobind/eigen/dense.h>
#include <nanobind/nanobind.h>

#include "law_design/condensed_problem.hpp"
#include "law_design/constraint_tightening.hpp"
#include "law_design/design_error.hpp"
#include "law_design/discretisation.hpp"
#include "law_design/estimator_design.hpp"
#include "law_design/joint_model.hpp"
#include "law_design/terminal_cost.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace eampc::law_design {
namespace {

void bind_joint_model(nb::module_& m) {
  nb::class_<JointData>(m, "JointData", "Joint, muscle and valve data of Table I, with units.")
      .def(nb::init<>())
      .def_rw("moment_of_inertia_kg_m2", &JointData::moment_of_inertia_kg_m2)
      .def_rw("viscous_damping_N_m_s_rad", &JointData::viscous_damping_N_m_s_rad)
      .def_rw("gear_radius_m", &JointData::gear_radius_m)
      .def_rw("k1_N_per_MPa", &JointData::k1_N_per_MPa)
      .def_rw("k2_N_per_MPa", &JointData::k2_N_per_MPa)
      .def_rw("k3_N_per_MPa", &JointData::k3_N_per_MPa)
      .def_rw("initial_contraction_ratio", &JointData::initial_contraction_ratio)
      .def_rw("initial_length_m", &JointData::initial_length_m)
      .def_rw("pressure_gain_MPa_per_V", &JointData::pressure_gain_MPa_per_V)
      .def_rw("control_gain_V", &JointData::control_gain_V)
      .def_rw("bias_V", &JointData::bias_V)
      .def_rw("valve_time_constant_s", &JointData::valve_time_constant_s);
  nb::class_<ContinuousModel>(m, "ContinuousModel", "dx/dt = A x + B u + (d; 0), equation (9).")
      .def_ro("b", &ContinuousModel::b)
      .def_ro("b1", &ContinuousModel::b1)
      .def_ro("b2", &ContinuousModel::b2)
      .def_ro("valve_time_constant_s", &ContinuousModel::valve_time_constant_s)
      .def_prop_ro("A", [](const ContinuousModel& c) { return c.A; })
      .def_prop_ro("B", [](const ContinuousModel& c) { return c.B; })
      .def_prop_ro("joint_A", &ContinuousModel::joint_A, "A on (angle, velocity) alone.")
      .def_prop_ro("joint_B", &ContinuousModel::joint_B)
      .def_prop_ro("order", &ContinuousModel::order);
  m.def("joint_model", &joint_model, "joint"_a);
}

void bind_discretisation(nb::module_& m) {
  nb::class_<SampledModel>(m, "SampledModel", "x+ = A_star x + B_star u + D delta.")
      .def_ro("period_s", &SampledModel::period_s)
      .def_prop_ro("A_star", [](const SampledModel& s) { return s.A_star; })
      .def_prop_ro("B_star", [](const SampledModel& s) { return s.B_star; })
      .def_prop_ro("D", [](const SampledModel& s) { return s.D; });
  m.def("discretise", &discretise, "A"_a, "B"_a, "period_s"_a,
        "Sampled model by one matrix exponential; A may be singular.");
  m.def("riccati_solution", &riccati_solution, "A"_a, "B"_a, "Q"_a, "R"_a);
}

void bind_tightening(nb::module_& m) {
  nb::class_<StateBounds>(m, "StateBounds")
      .def(nb::init<>())
      .def_rw("angle_max_rad", &StateBounds::angle_max_rad)
      .def_rw("velocity_max_rad_s", &StateBounds::velocity_max_rad_s)
      .def_rw("control_max", &StateBounds::control_max);
  nb::class_<LipschitzConstants>(m, "LipschitzConstants", "Constants of Assumption 2.2.")
      .def(nb::init<>())
      .def_rw("l_delta", &LipschitzConstants::l_delta)
      .def_rw("l_t", &LipschitzConstants::l_t)
      .def_rw("b_delta", &LipschitzConstants::b_delta)
      .def_rw("l_delta_t", &LipschitzConstants::l_delta_t)
      .def_rw("b_delta_t", &LipschitzConstants::b_delta_t)
      .def_rw("l_delta_x", &LipschitzConstants::l_delta_x)
      .def_rw("b_delta_x", &LipschitzConstants::b_delta_x);
  m.def("theorem_tightening", &theorem_tightening, "A"_a, "B"_a, "bounds"_a, "constants"_a,
        "adaptation_rate_per_s"_a, "period_s"_a, "horizon"_a,
        "(horizon + 1, 2): the norm bound of (22), the same in both columns.");
  m.def(
      "componentwise_tightening",
      [](const Eigen::Matrix2d& A, double disturbance_max_rad_s2,
         double disturbance_rate_max_rad_s3, double estimate_age_s, double estimate_relative_bias,
         double period_s, int horizon) {
        return componentwise_tightening(
            A,
            {.max_rad_s2 = disturbance_max_rad_s2, .rate_max_rad_s3 = disturbance_rate_max_rad_s3},
            {.age_s = estimate_age_s, .relative_bias = estimate_relative_bias}, period_s, horizon);
      },
      "A"_a, "disturbance_max_rad_s2"_a, "disturbance_rate_max_rad_s3"_a, "estimate_age_s"_a,
      "estimate_relative_bias"_a, "period_s"_a, "horizon"_a,
      "(horizon + 1, 2): bounds on the prediction error of angle and velocity.");
  m.def("require_room", &require_room, "tightening"_a, "bounds"_a, "kind"_a,
        "Raise DesignError if a tightened bound leaves no room.");
}

void bind_estimator_design(nb::module_& m) {
  m.def("estimator_decay", &estimator_decay, "adaptation_rate_per_s"_a, "period_s"_a);
  m.def("disturbance_inverse", &disturbance_inverse, "model"_a);
  m.def("low_pass_alpha", &low_pass_alpha, "frequency_hz"_a, "period_s"_a);
  m.def(
      "kalman_gains",
      [](const Eigen::Matrix2d& joint_A, double angle_noise_rad,
         double disturbance_walk_rad_s2_sqrt_Hz, double velocity_walk_rad_s_sqrt_Hz,
         double period_s) {
        const KalmanGains gains =
            kalman_gains(joint_A,
                         {.angle_noise_rad = angle_noise_rad,
                          .disturbance_walk_rad_s2_sqrt_Hz = disturbance_walk_rad_s2_sqrt_Hz,
                          .velocity_walk_rad_s_sqrt_Hz = velocity_walk_rad_s_sqrt_Hz},
                         period_s);
        return Eigen::Vector3d(gains.state(0), gains.state(1), gains.disturbance);
      },
      "joint_A"_a, "angle_noise_rad"_a, "disturbance_walk_rad_s2_sqrt_Hz"_a,
      "velocity_walk_rad_s_sqrt_Hz"_a, "period_s"_a,
      "Gains on (angle, velocity, disturbance) per rad of innovation.");
}

void bind_condensed_problem(nb::module_& m) {
  nb::class_<ControlProblem>(m, "ControlProblem", "Horizons, weights, bounds, parameter box.")
      .def(nb::init<>())
      .def_rw("horizon", &ControlProblem::horizon)
      .def_rw("control_horizon", &ControlProblem::control_horizon)
      .def_rw("weight_angle", &ControlProblem::weight_angle)
      .def_rw("weight_velocity", &ControlProblem::weight_velocity)
      .def_rw("weight_control", &ControlProblem::weight_control)
      .def_rw("weight_control_rate", &ControlProblem::weight_control_rate)
      .def_rw("angle_max_rad", &ControlProblem::angle_max_rad)
      .def_rw("velocity_max_rad_s", &ControlProblem::velocity_max_rad_s)
      .def_rw("control_max", &ControlProblem::control_max)
      .def_rw("stage_step", &ControlProblem::stage_step)
      .def_rw("soft_state_bounds", &ControlProblem::soft_state_bounds)
      .def_rw("slack_linear", &ControlProblem::slack_linear)
      .def_rw("slack_quadratic", &ControlProblem::slack_quadratic)
      .def_rw("tightening", &ControlProblem::tightening)
      .def_rw("reference_is_parameter", &ControlProblem::reference_is_parameter)
      .def_rw("fixed_reference_rad", &ControlProblem::fixed_reference_rad)
      .def_rw("lower", &ControlProblem::lower)
      .def_rw("upper", &ControlProblem::upper);
  nb::class_<CondensedProblem>(
      m, "CondensedProblem",
      "min U'HU/2 + (F p + f)'U subject to G U <= w + S p; u = output_U.U + output_p.p + "
      "output_offset.")
      .def_prop_ro("H", [](const CondensedProblem& c) { return c.mpqp.H; })
      .def_prop_ro("F", [](const CondensedProblem& c) { return c.mpqp.F; })
      .def_prop_ro("f", [](const CondensedProblem& c) { return c.mpqp.f; })
      .def_prop_ro("G", [](const CondensedProblem& c) { return c.mpqp.G; })
      .def_prop_ro("w", [](const CondensedProblem& c) { return c.mpqp.w; })
      .def_prop_ro("S", [](const CondensedProblem& c) { return c.mpqp.S; })
      .def_prop_ro("lower", [](const CondensedProblem& c) { return c.mpqp.lower; })
      .def_prop_ro("upper", [](const CondensedProblem& c) { return c.mpqp.upper; })
      .def_prop_ro("output_U", [](const CondensedProblem& c) { return c.output_U; })
      .def_prop_ro("output_p", [](const CondensedProblem& c) { return c.output_p; })
      .def_ro("output_offset", &CondensedProblem::output_offset);
  m.def("paper_problem", &paper_problem, "model"_a, "problem"_a);
  m.def("tracking_problem", &tracking_problem, "model"_a, "problem"_a);
}

}  // namespace

void bind_model(nb::module_& m) {
  nb::exception<DesignError>(m, "DesignError", PyExc_ValueError);
  bind_joint_model(m);
  bind_discretisation(m);
  bind_tightening(m);
  bind_estimator_design(m);
  bind_condensed_problem(m);
}

}  // namespace eampc::law_design
