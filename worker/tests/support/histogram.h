// Counts on a grid over the unit square, and one more cell for what falls nowhere.
#pragma once

#include <algorithm>
#include <span>
#include <vector>

namespace metrofarm::test {

class Histogram {
 public:
  Histogram(int columns, int rows)
      : columns_(columns), rows_(rows), cells_(size_t(columns) * rows + 1, 0.0) {}

  int columns() const { return columns_; }
  int rows() const { return rows_; }

  // u and v outside [0, 1) by a rounding error count in the border cells.
  void add(double u, double v, double weight = 1) { cells_[cell(u, v)] += weight; }
  void add_outside(double weight = 1) { cells_.back() += weight; }
  void add_to(int column, int row, double weight) {
    cells_[size_t(row) * columns_ + column] += weight;
  }
  // What falls nowhere makes up the rest of `total`.
  void complete_to(double total) {
    for (size_t i = 0; i + 1 < cells_.size(); ++i) total -= cells_[i];
    cells_.back() = total;
  }

  std::span<const double> counts() const { return cells_; }

 private:
  size_t cell(double u, double v) const {
    const int column = std::clamp(static_cast<int>(u * columns_), 0, columns_ - 1);
    const int row = std::clamp(static_cast<int>(v * rows_), 0, rows_ - 1);
    return size_t(row) * columns_ + column;
  }

  int columns_, rows_;
  std::vector<double> cells_;
};

}  // namespace metrofarm::test
