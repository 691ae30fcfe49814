// The sections of a law file: each read_… checks one table of the payload and fills its part of the
// configuration, or throws LawFileError with the key that is wrong.
#pragma once

#include "control/controller_config.hpp"
#include "service/law_file.hpp"
#include "service/law_tables.hpp"
#include "service/law_value.hpp"

namespace eampc::service {

void read_model(const LawValue& model, double period_s, control::DiscreteModel& out);
void read_estimator(const LawValue& estimator, double period_s, control::EstimatorConfig& out);
// Pieces and evaluator of the section law, without defect.
LawTables read_law_tables(const LawValue& law, int np);
void read_law(const LawValue& law, const control::ControllerConfig& config,
              control::LawConfig& out);
void read_valve(const LawValue& valve, const LawValue& law, const control::ControllerConfig& config,
                control::ValveConfig& out);
// Needs the model and the valves, for its times and slew limits.
void read_safety(const LawValue& safety, const control::ControllerConfig& config,
                 control::SafetyConfig& out);
void read_bus(const LawValue& bus, control::ControllerConfig& config);
void read_meta(const LawValue& payload, LawMeta& meta);

}  // namespace eampc::service
