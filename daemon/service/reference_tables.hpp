// Owns the reference tables the control loop reads in place, until the loop hands them back.
#pragma once

#include <cstddef>
#include <vector>

#include "control/reference_trajectory.hpp"
#include "realtime/command_queue.hpp"

namespace eampc::service {

class ReferenceTables {
 public:
  // All tables together; twice the largest single one, so that one can be replaced by another. 9.6
  // MB.
  static constexpr std::size_t kMaxRows = 120'000;

  // Returns the table's address for as long as the loop needs it, or null if there is no room.
  const control::Reference* keep(std::vector<control::Reference> table);
  void drop(const control::Reference* table);
  void collect(realtime::ReleasedTableQueue& released);
  std::size_t rows() const noexcept;

 private:
  std::vector<std::vector<control::Reference>> tables_;
};

}  // namespace eampc::service
