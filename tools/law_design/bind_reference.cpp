#include "law_design/bind_reference.hpp"

namespace eampc::law_design {

control::ReferenceTrajectory reference_trajectory(const ReferenceArguments& arguments,
                                                  std::vector<control::Reference>& rows) {
  control::ReferenceTrajectory trajectory;
  trajectory.amplitude_rad = arguments.amplitude_rad;
  trajectory.offset_rad = arguments.offset_rad;
  trajectory.start_s = arguments.start_s;
  trajectory.frequency_hz = arguments.frequency_hz;
  if (arguments.kind == "constant") {
    trajectory.kind = control::ReferenceKind::kConstant;
  } else if (arguments.kind == "step") {
    trajectory.kind = control::ReferenceKind::kStep;
  } else if (arguments.kind == "sine") {
    trajectory.kind = control::ReferenceKind::kSine;
  } else if (arguments.kind == "table") {
    const auto& table = arguments.table;
    if (!table || table->shape(0) < 1 || table->shape(1) != 3 ||
        !(arguments.sample_period_s > 0.0)) {
      throw nanobind::value_error(
          "a table needs rows of angle, velocity, acceleration and a positive sample_period_s");
    }
    rows.clear();
    for (std::size_t i = 0; i < table->shape(0); ++i) {
      rows.push_back({(*table)(i, 0), (*table)(i, 1), (*table)(i, 2)});
    }
    trajectory.kind = control::ReferenceKind::kTable;
    trajectory.table = rows.data();
    trajectory.samples = static_cast<std::int32_t>(rows.size());
    trajectory.sample_period_s = arguments.sample_period_s;
  } else {
    throw nanobind::value_error("kind is one of constant, step, sine, table");
  }
  return trajectory;
}

}  // namespace eampc::law_design
