// Any sequence of frames, silences, edges, references and bus reports through the control cycle.
// First byte: which controller; the rest: cycle_script.hpp. EAMPC_FUZZ_LAW=FILE adds the controller
// of a law file.
#include <optional>

#include "fuzz/cycle_script.hpp"
#include "fuzz/fuzz_configurations.hpp"
#include "service/law_file.hpp"

namespace {

using eampc::control::ControllerConfig;

const eampc::service::LawFile* law_of_environment() {
  static const std::optional<eampc::service::LawFile> law = [] {
    const char* path = std::getenv("EAMPC_FUZZ_LAW");
    return path == nullptr ? std::nullopt : std::optional(eampc::service::LawFile::load(path));
  }();
  return law ? &*law : nullptr;
}

const ControllerConfig& configuration(std::uint8_t choice) {
  const auto& joints = eampc::fuzz::joints();
  const eampc::service::LawFile* law = law_of_environment();
  const std::size_t index = choice % (joints.size() + (law != nullptr ? 1 : 0));
  return index < joints.size() ? joints[index].config : law->config();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  eampc::fuzz::ByteReader bytes(data, size);
  const ControllerConfig& config = configuration(bytes.take<std::uint8_t>());
  eampc::fuzz::CycleScript(config, bytes).run();
  return 0;
}
