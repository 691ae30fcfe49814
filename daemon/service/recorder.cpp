#include "service/recorder.hpp"

#include <array>
#include <cerrno>
#include <charconv>
#include <concepts>
#include <cstring>
#include <string_view>

#include "service/options.hpp"

namespace eampc::service {
namespace {

constexpr std::string_view kHeader =
    "cycle,scenario_time_s,reference_angle_rad,reference_velocity_rad_s,measured_angle_rad,angle_"
    "rad,"
    "velocity_rad_s,valve_control,disturbance_rad_s2,control,u1_V,u2_V,region,mode,fault,present_"
    "faults,limits,"
    "arrival_to_wake_us,wake_to_decided_us,decided_to_sent_us,arrival_to_sent_us\n";

// Shortest text that reads back as the same number.
void append(std::string& line, auto number) requires std::integral<decltype(number)> ||
    std::floating_point<decltype(number)> {
  std::array<char, 32> text;
  const auto [end, error] = std::to_chars(text.data(), text.data() + text.size(), number);
  line.append(text.data(), end);
  line += ',';
}

void append(std::string& line, const char* text) {
  line += text;
  line += ',';
}

}  // namespace

Recorder::Recorder(const std::string& path) : file_(std::fopen(path.c_str(), "we")) {
  if (!file_) {
    throw BadInput("cannot write the record file " + path + ": " + std::strerror(errno) +
                   "; choose another path with --record");
  }
  complete_ = std::fwrite(kHeader.data(), 1, kHeader.size(), file_.get()) == kHeader.size();
}

void Recorder::write(const realtime::LoopRecord& record) {
  const control::CycleRecord& cycle = record.cycle;
  line_.clear();
  append(line_, cycle.cycle);
  append(line_, cycle.scenario_time_s);
  append(line_, cycle.reference.angle_rad);
  append(line_, cycle.reference.velocity_rad_s);
  if (cycle.sample.verdict == control::SampleVerdict::kValid) {
    append(line_, cycle.sample.angle_rad);
  } else {
    append(line_, "nan");
  }
  append(line_, cycle.state.x[0]);
  append(line_, cycle.state.x[1]);
  append(line_, cycle.state.x[2]);
  append(line_, cycle.disturbance.for_law[1]);
  append(line_, cycle.law.u);
  append(line_, cycle.valves.u1_V);
  append(line_, cycle.valves.u2_V);
  append(line_, cycle.law.region);
  append(line_, control::mode_text(cycle.mode));
  append(line_, control::fault_name(cycle.fault));
  append(line_, cycle.present_faults.bits());
  append(line_, cycle.limits);
  append(line_, record.arrival_to_wake_us);
  append(line_, record.wake_to_decided_us);
  append(line_, record.decided_to_sent_us);
  append(line_, record.arrival_to_sent_us);
  line_.back() = '\n';
  if (std::fwrite(line_.data(), 1, line_.size(), file_.get()) != line_.size()) complete_ = false;
}

bool Recorder::close() {
  if (file_ && std::fclose(file_.release()) != 0) complete_ = false;
  return complete_;
}

}  // namespace eampc::service
