#include "service/reference_tables.hpp"

#include <utility>

namespace eampc::service {

const control::Reference* ReferenceTables::keep(std::vector<control::Reference> table) {
  if (rows() + table.size() > kMaxRows) return nullptr;
  tables_.push_back(std::move(table));
  return tables_.back().data();  // stays put when the outer vector grows: inner vectors are moved
}

void ReferenceTables::drop(const control::Reference* table) {
  std::erase_if(tables_, [&](const auto& kept) { return kept.data() == table; });
}

void ReferenceTables::collect(realtime::ReleasedTableQueue& released) {
  const control::Reference* table = nullptr;
  while (released.pop(table)) drop(table);
}

std::size_t ReferenceTables::rows() const noexcept {
  std::size_t rows = 0;
  for (const auto& table : tables_) rows += table.size();
  return rows;
}

}  // namespace eampc::service
