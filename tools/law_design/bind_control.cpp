// Python's view of the code that the daemon runs: law file, explicit law, control cycle, frame
// codec.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <memory>
#include <optional>

#include "control/control_cycle.hpp"
#include "control/frame_codec.hpp"
#include "law_design/bind_reference.hpp"
#include "law_design/numpy_column.hpp"
#include "law_design/offline_config.hpp"
#include "service/law_file.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace eampc::law_design {
namespace {

using control::CycleRecord;
using service::LawFile;

LawFile law_from_bytes(const nb::bytes& data, const std::string& name) {
  return LawFile::from_bytes({static_cast<const std::uint8_t*>(data.data()), data.size()}, name);
}

nb::tuple evaluate_law(const LawFile& law, const RowArray& P) {
  const auto np = static_cast<std::size_t>(law.config().law.packed.n_parameters);
  if (P.shape(1) != np) {
    throw nb::value_error(("P has " + std::to_string(P.shape(1)) + " columns, the law has " +
                           std::to_string(np) + " parameters")
                              .c_str());
  }
  const std::size_t n = P.shape(0);
  std::vector<double> u(n);
  std::vector<std::int32_t> region(n);
  std::vector<std::uint8_t> clamped(n);
  {
    const nb::gil_scoped_release released;
    const control::ExplicitLaw explicit_law(law.config());
    const double* row = P.data();
    for (std::size_t i = 0; i < n; ++i, row += np) {
      control::ParameterVector p{};
      std::copy_n(row, np, p.begin());
      const control::LawOutput output = explicit_law.at(p);
      u[i] = output.u;
      region[i] = output.region;
      clamped[i] = output.parameter_clamped ? 1 : 0;
    }
  }
  return nb::make_tuple(numpy_column(std::move(u)), numpy_column(std::move(region)),
                        numpy_column(std::move(clamped)).attr("astype")("bool"));
}

// The cycle keeps a reference to its configuration, and the trajectory's table must outlive
// its use.
class BoundCycle {
 public:
  BoundCycle(std::shared_ptr<const LawFile> law, bool monitored)
      : law_(std::move(law)),
        config_(monitored ? law_->config() : offline_config(law_->config())),
        cycle_(config_) {}
  BoundCycle(const BoundCycle&) = delete;
  BoundCycle& operator=(const BoundCycle&) = delete;

  void observe(std::uint32_t id, const nb::bytes& data, bool extended) {
    cycle_.observe(frame_of(id, data, extended));
  }

  nb::dict step(std::optional<std::uint32_t> id, std::optional<nb::bytes> data,
                const std::string& action, bool extended, bool send_failed) {
    control::Frame frame;
    control::CycleInput input;
    if (id) {
      if (!data) throw nb::value_error("a frame needs data of 0 to 8 bytes");
      frame = frame_of(*id, *data, extended);
      input.encoder_frame = &frame;
    }
    input.action = action_of(action);
    input.bus.send_refused = send_failed;
    input.bus.queue_proved_empty = true;
    input.new_reference = new_reference_ ? &trajectory_ : nullptr;
    const control::CycleOutput output = cycle_.step(input);
    new_reference_ = false;
    return dict_of(output);
  }

  void set_reference(const std::string& kind, double amplitude_rad, double offset_rad,
                     double start_s, double frequency_hz, std::optional<RowArray> table,
                     double sample_period_s) {
    trajectory_ = reference_trajectory(
        {kind, amplitude_rad, offset_rad, start_s, frequency_hz, std::move(table), sample_period_s},
        table_);
    new_reference_ = true;
  }

  bool at_rest() const { return cycle_.at_rest(); }

 private:
  static control::Frame frame_of(std::uint32_t id, const nb::bytes& data, bool extended) {
    control::Frame frame;
    if (data.size() > frame.data.size()) {
      throw nb::value_error("a frame needs data of 0 to 8 bytes");
    }
    frame.id = id;
    frame.extended = extended;
    frame.length = static_cast<std::uint8_t>(data.size());
    std::copy_n(static_cast<const std::uint8_t*>(data.data()), data.size(), frame.data.begin());
    return frame;
  }

  static control::OperatorAction action_of(const std::string& action) {
    if (action == "none") return control::OperatorAction::kNone;
    if (action == "arm") return control::OperatorAction::kArm;
    if (action == "disarm") return control::OperatorAction::kDisarm;
    if (action == "reset") return control::OperatorAction::kReset;
    throw nb::value_error("action is one of none, arm, disarm, reset");
  }

  static nb::dict dict_of(const control::CycleOutput& output) {
    const CycleRecord& record = output.record;
    nb::dict row;
    row["command_id"] = output.command.id;
    row["command"] = nb::bytes(output.command.data.data(), output.command.length);
    row["cycle"] = record.cycle;
    row["scenario_time_s"] = record.scenario_time_s;
    row["verdict"] = control::verdict_text(record.sample.verdict);
    row["measured_angle_rad"] = record.sample.angle_rad;
    row["measured_velocity_rad_s"] = record.sample.velocity_rad_s;
    row["missed_frames"] = record.sample.missed_frames;
    row["angle_rad"] = record.state.x[0];
    row["velocity_rad_s"] = record.state.x[1];
    row["valve_control"] = record.state.x[2];
    row["disturbance_rad_s2"] = record.disturbance.for_law[1];
    row["reference_angle_rad"] = record.reference.angle_rad;
    row["reference_velocity_rad_s"] = record.reference.velocity_rad_s;
    row["control"] = record.law.u;
    row["region"] = record.law.region;
    row["u1_V"] = record.valves.u1_V;
    row["u2_V"] = record.valves.u2_V;
    row["enable"] = record.valves.enable;
    row["mode"] = control::mode_text(record.mode);
    row["fault"] = static_cast<int>(record.fault);
    row["fault_text"] = control::fault_text(record.fault);
    row["fault_name"] = control::fault_name(record.fault);
    row["present_faults"] = record.present_faults.bits();
    row["refusal"] = static_cast<int>(record.refusal);
    row["refusal_text"] = control::refusal_text(record.refusal);
    row["refusal_cause"] = static_cast<int>(record.refusal_cause);
    row["limits"] = record.limits;
    return row;
  }

  std::shared_ptr<const LawFile> law_;
  control::ControllerConfig config_;
  control::ControlCycle cycle_;
  control::ReferenceTrajectory trajectory_;
  std::vector<control::Reference> table_;
  bool new_reference_ = false;
};

control::SignalLayout layout_of(const nb::dict& signal) {
  control::SignalLayout layout;
  layout.present = true;
  layout.start_bit = nb::cast<int>(signal["start_bit"]);
  layout.length = nb::cast<int>(signal["length"]);
  layout.little_endian = nb::cast<bool>(signal["little_endian"]);
  layout.is_signed = nb::cast<bool>(signal["is_signed"]);
  layout.factor = nb::cast<double>(signal["factor"]);
  layout.offset = nb::cast<double>(signal["offset"]);
  if (layout.length < 1 || !control::fits(layout, 8)) {
    throw nb::value_error("the signal does not fit into 8 bytes");
  }
  return layout;
}

control::FrameData data_of(const nb::bytes& bytes) {
  control::FrameData data{};
  if (bytes.size() > data.size()) {
    throw nb::value_error("a classic CAN frame has at most 8 bytes");
  }
  std::copy_n(static_cast<const std::uint8_t*>(bytes.data()), bytes.size(), data.begin());
  return data;
}

void bind_frame_codec(nb::module_& m) {
  m.def(
      "encode_signals",
      [](const std::vector<nb::dict>& layouts, const std::vector<double>& values, int length) {
        if (layouts.size() != values.size() || length < 0 || length > 8) {
          throw nb::value_error("needs one value per layout and a length of 0 to 8 bytes");
        }
        control::FrameData data{};
        for (std::size_t i = 0; i < layouts.size(); ++i) {
          control::encode_signal(data, layout_of(layouts[i]), values[i]);
        }
        return nb::bytes(data.data(), static_cast<std::size_t>(length));
      },
      "layouts"_a, "values"_a, "length"_a = 8,
      "Physical values into the bytes of one frame: rounded to nearest (half to even), saturated "
      "at the raw range.\n\n"
      "layouts: dicts with start_bit, length, little_endian, is_signed, factor, offset, as in the "
      "law file.\n"
      "ValueError: a signal does not fit into 8 bytes.");
  m.def(
      "decode_signals",
      [](const std::vector<nb::dict>& layouts, const nb::bytes& bytes) {
        const control::FrameData data = data_of(bytes);
        std::vector<double> values;
        for (const nb::dict& layout : layouts) {
          values.push_back(control::decode_signal(data, layout_of(layout)));
        }
        return values;
      },
      "layouts"_a, "data"_a, "Bytes of one frame → physical values, in the order of the layouts.");
  m.def(
      "frame_crc",
      [](const nb::bytes& bytes, int byte, int data_id) {
        control::CrcLayout layout;
        layout.byte = byte;
        layout.data_id = static_cast<std::uint16_t>(data_id);
        return static_cast<int>(
            control::frame_crc(data_of(bytes), static_cast<int>(bytes.size()), layout));
      },
      "data"_a, "byte"_a, "data_id"_a,
      "SAE J1850 CRC-8 over data_id (low byte, high byte), then every byte of data but number "
      "`byte`.");
}

}  // namespace

void bind_control(nb::module_& m) {
  nb::exception<service::LawFileError>(m, "LawFileError", PyExc_ValueError);
  nb::class_<LawFile>(m, "Law",
                      "A checked law file: what the daemon would run. Units are in the names.")
      .def_prop_ro("rig_name", [](const LawFile& law) { return law.meta().rig_name; })
      .def_prop_ro("description", [](const LawFile& law) { return law.meta().description; })
      .def_prop_ro("variant", [](const LawFile& law) { return law.meta().variant; })
      .def_prop_ro("inputs_sha256", [](const LawFile& law) { return law.meta().inputs_sha256; })
      .def_prop_ro("inputs_crc32", [](const LawFile& law) { return law.meta().inputs_crc32; })
      .def_prop_ro("eampc_version", [](const LawFile& law) { return law.meta().eampc_version; })
      .def_prop_ro("formulation", [](const LawFile& law) { return law.meta().formulation; })
      .def_prop_ro("trigger", [](const LawFile& law) { return law.meta().trigger; })
      .def_prop_ro("parameter_names", [](const LawFile& law) { return law.meta().parameter_names; })
      .def_prop_ro("parameter_units", [](const LawFile& law) { return law.meta().parameter_units; })
      .def_prop_ro("statistics", [](const LawFile& law) { return law.meta().statistics; })
      .def_prop_ro("lcm_url", [](const LawFile& law) { return law.meta().lcm_url; })
      .def_prop_ro("period_s", [](const LawFile& law) { return law.config().model.period_s; })
      .def_prop_ro("order", [](const LawFile& law) { return law.config().model.order; })
      .def_prop_ro("u_min", [](const LawFile& law) { return law.config().law.u_min; })
      .def_prop_ro("u_max", [](const LawFile& law) { return law.config().law.u_max; })
      .def_prop_ro("lower",
                   [](const LawFile& law) {
                     const auto& c = law.config().law;
                     return numpy_column(std::vector<double>(
                         c.lower.begin(), c.lower.begin() + c.packed.n_parameters));
                   })
      .def_prop_ro("upper",
                   [](const LawFile& law) {
                     const auto& c = law.config().law;
                     return numpy_column(std::vector<double>(
                         c.upper.begin(), c.upper.begin() + c.packed.n_parameters));
                   })
      .def("evaluate", &evaluate_law, "P"_a,
           "The law at many parameters: P (n, np) float64 → (u (n,), region (n,) int32, clamped "
           "(n,) bool).\n\n"
           "Each row is clamped onto the box first, u is clipped to u_min..u_max; the GIL is "
           "released.\n"
           "ValueError: wrong number of columns.");
  m.def(
      "fault_names",
      [] {
        std::vector<std::string> names;
        for (std::size_t number = 1; number < control::kFaultCount; ++number) {
          names.emplace_back(control::fault_name(static_cast<control::Fault>(number)));
        }
        return names;
      },
      "Names of the fault matrix, from number 1 on.");
  m.def(
      "load_law", [](const std::string& path) { return LawFile::load(path); }, "path"_a,
      "Load and check a law file. LawFileError: one sentence that names file, defect and mend.");
  m.def("law_from_bytes", &law_from_bytes, "data"_a, "name"_a = "law",
        "The same from bytes; `name` stands for the file in errors.");

  nb::class_<BoundCycle>(m, "ControlCycle", "The daemon's control cycle, one period per step.")
      .def(
          "__init__",
          // The law object is kept alive by this one; its tables are referred to, not copied.
          [](BoundCycle* self, LawFile& law, bool monitored) {
            new (self)
                BoundCycle(std::shared_ptr<const LawFile>(&law, [](const LawFile*) {}), monitored);
          },
          "law"_a, "monitored"_a = false, nb::keep_alive<1, 2>(),
          "monitored: the faults of the law file's monitored messages exist; hand those in by "
          "observe().")
      .def("observe", &BoundCycle::observe, "id"_a, "data"_a, "extended"_a = false,
           "A frame of a monitored message, for the next step.")
      .def("step", &BoundCycle::step, "id"_a = nb::none(), "data"_a = nb::none(),
           "action"_a = "none", "extended"_a = false, "send_failed"_a = false,
           "One period: encoder frame (id, data) or none → dict of the cycle's record and the "
           "command frame's bytes.\n\n"
           "action: none, arm, disarm or reset, taking effect in this period.")
      .def("set_reference", &BoundCycle::set_reference, "kind"_a, "amplitude_rad"_a = 0.0,
           "offset_rad"_a = 0.0, "start_s"_a = 0.0, "frequency_hz"_a = 0.0, "table"_a = nb::none(),
           "sample_period_s"_a = 0.0,
           "Reference from the next step on: constant, step, sine, or table (n, 3) of rad, rad/s, "
           "rad/s².")
      .def_prop_ro("at_rest", &BoundCycle::at_rest);
  bind_frame_codec(m);
}

}  // namespace eampc::law_design
