// Half-spaces a·x ≤ b, stored column by column so that the slacks of all of them at one point are
// a few long multiply-adds. Used for regions, cells of the evaluator and linear programs.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace eampc::law_design {

class HalfSpaces {
 public:
  explicit HalfSpaces(int dimension = 0) : dimension_(dimension) {}

  int dimension() const { return dimension_; }
  int size() const { return size_; }
  void clear() { size_ = 0; }

  /// Adds a·x ≤ b; `a` holds dimension() numbers.
  void append(const double* a, double b) {
    if (size_ == capacity_) grow();
    for (int j = 0; j < dimension_; ++j) columns_[at(size_, j)] = a[j];
    offsets_[static_cast<std::size_t>(size_)] = b;
    ++size_;
  }

  /// Removes the half-space added last.
  void pop() { --size_; }

  double normal(int row, int j) const { return columns_[at(row, j)]; }
  double offset(int row) const { return offsets_[static_cast<std::size_t>(row)]; }
  void set_offset(int row, double b) { offsets_[static_cast<std::size_t>(row)] = b; }
  void copy_normal(int row, double* a) const {
    for (int j = 0; j < dimension_; ++j) a[j] = columns_[at(row, j)];
  }

  const double* column(int j) const { return columns_.data() + at(0, j); }
  const double* offsets() const { return offsets_.data(); }

  /// a·x of one row.
  double product(int row, const double* x) const {
    double sum = 0.0;
    for (int j = 0; j < dimension_; ++j) sum += columns_[at(row, j)] * x[j];
    return sum;
  }

  /// a·x − b of every row into `excess`.
  void excess(const double* x, double* excess) const {
    const int m = size_;
    const double* b = offsets_.data();
    for (int i = 0; i < m; ++i) excess[i] = -b[i];
    for (int j = 0; j < dimension_; ++j) {
      const double* column_j = column(j);
      const double x_j = x[j];
      for (int i = 0; i < m; ++i) excess[i] += column_j[i] * x_j;
    }
  }

  /// True if a·x ≤ b + tolerance for every row.
  bool contains(const double* x, double tolerance) const {
    for (int i = 0; i < size_; ++i) {
      if (product(i, x) > offset(i) + tolerance) return false;
    }
    return true;
  }

 private:
  std::size_t at(int row, int j) const {
    return static_cast<std::size_t>(j) * static_cast<std::size_t>(capacity_) +
           static_cast<std::size_t>(row);
  }
  void grow() {
    const int capacity = capacity_ == 0 ? 16 : 2 * capacity_;
    std::vector<double> columns(static_cast<std::size_t>(capacity) *
                                static_cast<std::size_t>(dimension_));
    for (int j = 0; j < dimension_; ++j) {
      for (int i = 0; i < size_; ++i) {
        columns[static_cast<std::size_t>(j) * static_cast<std::size_t>(capacity) +
                static_cast<std::size_t>(i)] = columns_[at(i, j)];
      }
    }
    columns_ = std::move(columns);
    offsets_.resize(static_cast<std::size_t>(capacity));
    capacity_ = capacity;
  }

  int dimension_ = 0;
  int size_ = 0;
  int capacity_ = 0;
  std::vector<double> columns_;
  std::vector<double> offsets_;
};

}  // namespace eampc::law_design
