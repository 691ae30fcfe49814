#include "service/flight_recorder.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <msgpack.hpp>
#include <system_error>
#include <utility>

#include "service/options.hpp"

namespace eampc::service {
namespace {

static_assert(std::endian::native == std::endian::little,
              "doubles are written as they lie in memory");

using realtime::LoopRecord;

// After a fault the loop may fall silent (a dead bus in lock-step): the file does not wait longer.
constexpr std::chrono::seconds kLongestWait{3};

struct Column {
  const char* name;
  const char* unit;
  double (*value)(const LoopRecord& record);
};

double of_valid(const LoopRecord& record, double value) {
  return record.cycle.sample.verdict == control::SampleVerdict::kValid
             ? value
             : std::numeric_limits<double>::quiet_NaN();
}

constexpr Column kColumns[] = {
    {"cycle", "", [](const LoopRecord& r) { return static_cast<double>(r.cycle.cycle); }},
    {"arrival_s", "s since 1970",
     [](const LoopRecord& r) { return 1e-9 * static_cast<double>(r.arrival_ns); }},
    {"scenario_time_s", "s", [](const LoopRecord& r) { return r.cycle.scenario_time_s; }},
    {"mode", "", [](const LoopRecord& r) { return static_cast<double>(r.cycle.mode); }},
    {"fault", "", [](const LoopRecord& r) { return static_cast<double>(r.cycle.fault); }},
    {"present_faults", "bit set",
     [](const LoopRecord& r) { return static_cast<double>(r.cycle.present_faults.bits()); }},
    {"refusal", "", [](const LoopRecord& r) { return static_cast<double>(r.cycle.refusal); }},
    {"refusal_cause", "",
     [](const LoopRecord& r) { return static_cast<double>(r.cycle.refusal_cause); }},
    {"limits", "bit set", [](const LoopRecord& r) { return static_cast<double>(r.cycle.limits); }},
    {"verdict", "",
     [](const LoopRecord& r) { return static_cast<double>(r.cycle.sample.verdict); }},
    {"missed_frames", "",
     [](const LoopRecord& r) { return static_cast<double>(r.cycle.sample.missed_frames); }},
    {"encoder_status", "raw",
     [](const LoopRecord& r) { return static_cast<double>(r.cycle.sample.status_raw); }},
    {"measured_angle_rad", "rad",
     [](const LoopRecord& r) { return of_valid(r, r.cycle.sample.angle_rad); }},
    {"measured_velocity_rad_s", "rad/s",
     [](const LoopRecord& r) { return of_valid(r, r.cycle.sample.velocity_rad_s); }},
    {"angle_rad", "rad", [](const LoopRecord& r) { return r.cycle.state.x[0]; }},
    {"velocity_rad_s", "rad/s", [](const LoopRecord& r) { return r.cycle.state.x[1]; }},
    {"valve_control", "u", [](const LoopRecord& r) { return r.cycle.state.x[2]; }},
    {"disturbance_rad_s2", "rad/s2",
     [](const LoopRecord& r) { return r.cycle.disturbance.for_law[1]; }},
    {"reference_angle_rad", "rad", [](const LoopRecord& r) { return r.cycle.reference.angle_rad; }},
    {"reference_velocity_rad_s", "rad/s",
     [](const LoopRecord& r) { return r.cycle.reference.velocity_rad_s; }},
    {"control", "u", [](const LoopRecord& r) { return r.cycle.law.u; }},
    {"region", "", [](const LoopRecord& r) { return static_cast<double>(r.cycle.law.region); }},
    {"u1_V", "V", [](const LoopRecord& r) { return r.cycle.valves.u1_V; }},
    {"u2_V", "V", [](const LoopRecord& r) { return r.cycle.valves.u2_V; }},
    {"enable", "", [](const LoopRecord& r) { return r.cycle.valves.enable ? 1.0 : 0.0; }},
    {"pressure1_kPa", "kPa", [](const LoopRecord& r) { return r.cycle.pressure1_kPa; }},
    {"pressure2_kPa", "kPa", [](const LoopRecord& r) { return r.cycle.pressure2_kPa; }},
    {"supply_pressure_kPa", "kPa", [](const LoopRecord& r) { return r.cycle.supply_pressure_kPa; }},
    {"unconfirmed_periods", "",
     [](const LoopRecord& r) { return static_cast<double>(r.cycle.bus.unconfirmed_periods); }},
    {"arrival_to_wake_us", "us", [](const LoopRecord& r) { return r.arrival_to_wake_us; }},
    {"wake_to_decided_us", "us", [](const LoopRecord& r) { return r.wake_to_decided_us; }},
    {"decided_to_sent_us", "us", [](const LoopRecord& r) { return r.decided_to_sent_us; }},
    {"arrival_to_sent_us", "us", [](const LoopRecord& r) { return r.arrival_to_sent_us; }},
};
constexpr std::size_t kColumnCount = std::size(kColumns);

// Number → text of an enumeration whose texts end with "unknown".
template <typename Enum>
std::map<std::string, std::string> texts_of(const char* (*text)(Enum)) {
  std::map<std::string, std::string> texts;
  for (int number = 0; number < 256; ++number) {
    const std::string said = text(static_cast<Enum>(number));
    if (said == "unknown") break;
    texts[std::to_string(number)] = said;
  }
  return texts;
}

std::map<std::string, std::string> texts_of_limits() {
  std::map<std::string, std::string> texts;
  for (std::uint32_t bit = 1; bit != 0; bit <<= 1) {
    const std::string said = control::limit_text(static_cast<control::Limit>(bit));
    if (said == "unknown") break;
    texts[std::to_string(bit)] = said;
  }
  return texts;
}

std::string utc_now() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  ::gmtime_r(&now, &utc);
  std::array<char, 32> text{};
  std::strftime(text.data(), text.size(), "%Y%m%dT%H%M%SZ", &utc);
  return text.data();
}

}  // namespace

FlightRecorder::FlightRecorder(FlightSettings settings)
    : settings_(std::move(settings)), ring_(kCycles) {
  std::error_code error;
  std::filesystem::create_directories(settings_.folder, error);
  if (error) {
    throw BadInput("cannot make the folder " + settings_.folder + " for flight records: " +
                   error.message() + "; choose another one with --flight-folder, or none");
  }
}

void FlightRecorder::push(const LoopRecord& record) {
  ring_[next_] = record;
  next_ = (next_ + 1) % kCycles;
  count_ = std::min(count_ + 1, kCycles);
  const control::Fault fault = record.cycle.fault;
  if (fault != control::Fault::kNone && last_fault_ == control::Fault::kNone &&
      due_for_ == control::Fault::kNone) {
    due_for_ = fault;
    due_in_ = kCyclesAfterFault;
    due_at_ = std::chrono::steady_clock::now() + kLongestWait;
  } else if (due_in_ > 0) {
    --due_in_;
  }
  last_fault_ = fault;
}

FlightFile FlightRecorder::serve() {
  FlightFile written;
  if (due_for_ != control::Fault::kNone &&
      (due_in_ == 0 || std::chrono::steady_clock::now() >= due_at_)) {
    written = write(control::fault_name(due_for_), due_for_);
    due_for_ = control::Fault::kNone;
    due_in_ = 0;
  }
  const std::lock_guard lock(mutex_);
  if (asked_ == done_) return written;
  answer_ = write("request", control::Fault::kNone);
  done_ = asked_;
  answered_.notify_all();
  return answer_;
}

FlightFile FlightRecorder::finish() {
  due_in_ = 0;
  return serve();
}

FlightFile FlightRecorder::write_now(std::chrono::milliseconds limit) {
  std::unique_lock lock(mutex_);
  const std::uint64_t mine = ++asked_;
  if (!answered_.wait_for(lock, limit, [&] { return done_ >= mine; })) {
    return {"", "the flight record was not written in time"};
  }
  return answer_;
}

FlightFile FlightRecorder::write(const std::string& reason, control::Fault fault) {
  msgpack::sbuffer buffer;
  msgpack::packer<msgpack::sbuffer> to(buffer);
  const auto entry = [&](const char* key, const auto& value) {
    to.pack(key);
    to.pack(value);
  };
  to.pack_map(15);
  entry("format", "eampc-flight");
  entry("version", 1);
  entry("about",
        "The last control cycles of eampcd, one row each, oldest first. data holds rows times "
        "columns little-endian float64, row by row; texts gives the meaning of numbers and bits.");
  entry("eampc_version", EAMPC_VERSION);
  entry("written_utc", utc_now());
  entry("rig_name", settings_.rig_name);
  entry("law_sha256", settings_.law_sha256);
  entry("bus", settings_.bus_url);
  entry("period_s", settings_.period_s);
  entry("reason", reason);
  entry("fault", static_cast<int>(fault));
  entry("fault_text", control::fault_text(fault));
  to.pack("texts");
  to.pack_map(5);
  entry("mode", texts_of(&control::mode_text));
  entry("fault", texts_of(&control::fault_text));
  entry("refusal", texts_of(&control::refusal_text));
  entry("verdict", texts_of(&control::verdict_text));
  entry("limits", texts_of_limits());
  to.pack("columns");
  to.pack_array(kColumnCount);
  for (const Column& column : kColumns) {
    to.pack_map(2);
    entry("name", column.name);
    entry("unit", column.unit);
  }
  std::vector<double> data;
  data.reserve(count_ * kColumnCount);
  for (std::size_t row = 0; row < count_; ++row) {
    const LoopRecord& record = ring_[(next_ + kCycles - count_ + row) % kCycles];
    for (const Column& column : kColumns) data.push_back(column.value(record));
  }
  to.pack("data");
  to.pack_map(2);
  entry("shape", std::array<std::size_t, 2>{count_, kColumnCount});
  to.pack("f64");
  const auto size = static_cast<std::uint32_t>(data.size() * sizeof(double));
  to.pack_bin(size);
  to.pack_bin_body(reinterpret_cast<const char*>(data.data()), size);

  namespace fs = std::filesystem;
  const std::string stem = "flight-" + utc_now() + "-" + reason;
  fs::path path = fs::path(settings_.folder) / (stem + ".flight");
  std::error_code error;
  for (int n = 2; fs::exists(path, error); ++n) {
    path = fs::path(settings_.folder) / (stem + "-" + std::to_string(n) + ".flight");
  }
  const fs::path unfinished = path.string() + ".part";
  std::ofstream file(unfinished, std::ios::binary);
  file.write(buffer.data(), static_cast<std::streamsize>(buffer.size()));
  file.close();
  if (file) fs::rename(unfinished, path, error);
  if (!file || error) {
    fs::remove(unfinished, error);
    return {"", "cannot write the flight record " + path.string() +
                    "; is there room, and may eampcd write there?"};
  }
  forget_oldest();
  return {path.string(), ""};
}

void FlightRecorder::forget_oldest() const {
  namespace fs = std::filesystem;
  std::error_code error;
  std::vector<std::pair<fs::file_time_type, fs::path>> files;
  for (fs::directory_iterator entry(settings_.folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    std::error_code unreadable;
    if (name.starts_with("flight-") && name.ends_with(".flight")) {
      files.emplace_back(fs::last_write_time(entry->path(), unreadable), entry->path());
    }
  }
  std::sort(files.begin(), files.end());
  for (std::size_t i = 0; i + kMostFiles < files.size(); ++i) fs::remove(files[i].second, error);
}

std::string default_flight_folder() {
  const auto variable = [](const char* name) {
    const char* value = std::getenv(name);
    return std::string(value == nullptr ? "" : value);
  };
  const std::string systemd = variable("STATE_DIRECTORY");
  if (!systemd.empty()) return systemd.substr(0, systemd.find(':'));
  const std::string state = variable("XDG_STATE_HOME");
  if (!state.empty()) return state + "/eampc";
  const std::string home = variable("HOME");
  return home.empty() ? "" : home + "/.local/state/eampc";
}

}  // namespace eampc::service
