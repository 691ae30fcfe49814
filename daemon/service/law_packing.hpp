// LawTables → what runs: the law's tables in the order in which an evaluation reads them, eight
// hyperplanes or pieces side by side, in one 64-byte aligned block, and the evaluation chosen for
// this processor. Leaves that hold the same pieces share their rows. All allocation of a law
// happens here.
#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include "control/point_location.hpp"
#include "service/law_tables.hpp"

namespace eampc::service {

/// "best", "scalar", "vector128", "avx2" or "avx512"; throws std::invalid_argument for another.
control::EvaluationPath evaluation_path(const std::string& name);

/// Owns what a PackedLaw points into; moving keeps it valid.
class LawPacking {
 public:
  LawPacking() = default;
  /// Throws std::invalid_argument if the tables have a defect or this processor lacks the path.
  explicit LawPacking(const LawTables& tables,
                      control::EvaluationPath path = control::EvaluationPath::kBest);

  LawPacking(LawPacking&&) noexcept = default;
  LawPacking& operator=(LawPacking&&) noexcept = default;
  LawPacking(const LawPacking&) = delete;
  LawPacking& operator=(const LawPacking&) = delete;

  const control::PackedLaw& law() const noexcept { return law_; }
  /// Of all that an evaluation may read.
  std::size_t bytes() const noexcept { return bytes_; }

 private:
  struct Release {
    void operator()(std::byte* memory) const noexcept;
  };

  control::PackedLaw law_;
  std::unique_ptr<std::byte, Release> memory_;
  std::size_t bytes_ = 0;
};

}  // namespace eampc::service
