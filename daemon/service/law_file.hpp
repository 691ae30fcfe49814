// The law file: MessagePack bytes → a checked ControllerConfig with the storage of its packed law.
// Checked before anything real-time starts: format, checksum, every size, range and number, that
// the signals fit their frames without overlap, that every path of the law's tree ends in a leaf
// within the stated depth, and that an evaluation takes the stated number of operations. Absent:
// the design problem kept beside the law (for Python's eyes), any writing.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "control/controller_config.hpp"
#include "service/law_packing.hpp"

namespace eampc::service {

// One sentence: which file, what is wrong, how to fix it.
class LawFileError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

struct LawMeta {
  std::string rig_name;
  std::string description;
  std::string variant;  // empty: none
  std::string inputs_sha256;
  std::uint32_t inputs_crc32 = 0;
  std::string eampc_version;
  std::string formulation;  // "paper" or "tracking"
  std::string trigger;      // "encoder" or "sync"
  std::vector<std::string> parameter_names;
  std::vector<std::string> parameter_units;
  std::map<std::string, double>
      statistics;  // regions, pieces, depth, nodes, rows_before, rows_kept, seconds
  std::string lcm_url;
  std::int32_t state_decimation = 1;
  bool reference_by_lcm = false;
};

class LawFile {
 public:
  static LawFile load(const std::string& path,
                      control::EvaluationPath evaluation = control::EvaluationPath::kBest);
  // `name` stands for the file in error sentences.
  static LawFile from_bytes(std::span<const std::uint8_t> bytes, const std::string& name,
                            control::EvaluationPath evaluation = control::EvaluationPath::kBest);

  // The configuration's law points into this object: moving keeps it, copying is not possible.
  LawFile(LawFile&&) noexcept = default;
  LawFile& operator=(LawFile&&) noexcept = default;
  LawFile(const LawFile&) = delete;
  LawFile& operator=(const LawFile&) = delete;

  const control::ControllerConfig& config() const noexcept { return config_; }
  const LawMeta& meta() const noexcept { return meta_; }

 private:
  LawFile() = default;

  control::ControllerConfig config_;
  LawMeta meta_;
  LawPacking packing_;
};

}  // namespace eampc::service
