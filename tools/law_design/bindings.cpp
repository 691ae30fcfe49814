// The Python module eampc._core: one function per part, each in its bind_*.cpp.
#include <nanobind/nanobind.h>

namespace eampc::law_design {

void bind_mpqp(nanobind::module_& m);
void bind_law_tables(nanobind::module_& m);
void bind_model(nanobind::module_& m);
void bind_control(nanobind::module_& m);
void bind_simulation(nanobind::module_& m);
void bind_step_timing(nanobind::module_& m);
void bind_timing(nanobind::module_& m);
void bind_verification(nanobind::module_& m);
void bind_worst_vertex(nanobind::module_& m);
void bind_certificate(nanobind::module_& m);

}  // namespace eampc::law_design

NB_MODULE(_core, m) {
  m.doc() = "Offline core of eampc: model, condensed problem, explicit law, simulated closed loop.";
  eampc::law_design::bind_mpqp(m);
  eampc::law_design::bind_law_tables(m);
  eampc::law_design::bind_model(m);
  eampc::law_design::bind_control(m);
  eampc::law_design::bind_simulation(m);
  eampc::law_design::bind_step_timing(m);
  eampc::law_design::bind_timing(m);
  eampc::law_design::bind_verification(m);
  eampc::law_design::bind_worst_vertex(m);
  eampc::law_design::bind_certificate(m);
}
