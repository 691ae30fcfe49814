// The critical region of one active set, and which active sets lie beyond its facets.
//
// Where rows are dependent or multipliers vanish, several active sets describe the same solution.
// One of them is singled out by moving every bound by an amount ε·nudge, ε → 0+, nudge different
// for every row: the regions of that problem do not overlap, whatever the original's degeneracy,
// and what is left of them at ε = 0 tiles the parameters. So every constraint of a region carries
// the rate ("shift") at which ε moves it; constraints that vanish identically at ε = 0 hold if
// their shift is positive, and among facets that coincide the one with the least shift is the
// facet.
#pragma once

#include <Eigen/Dense>
#include <vector>

#include "law_design/least_distance_form.hpp"
#include "law_design/mpqp.hpp"
#include "law_design/polytope.hpp"
#include "law_design/quadratic_program.hpp"

namespace eampc::law_design {

/// Label of facets of parameter-only rows; other labels are rows of the least-distance form.
inline constexpr int kParameterLabel = -2;

/// An active set beyond a facet: `entering` is added and `leaving` taken out, -1 is none.
struct Crossing {
  int facet = -1;
  int entering = -1;
  int leaving = -1;
};

/// Every constraint of a region in q, unit rows.
struct RegionRows {
  HalfSpaces rows{0};
  std::vector<int> labels;
  std::vector<double> shifts;     ///< of the offset, per ε
  std::vector<double> roundings;  ///< error of normal and offset to expect
};

struct ExploredRegion {
  std::vector<int> active;             ///< rows of the least-distance form, ascending
  LeastDistanceForm::RowMatrix z;      ///< z = z·(q, 1), n×(np+1)
  Polytope polytope;                   ///< in q; labels are rows of the form, kBoxLabel or below
  std::vector<Crossing> crossings;     ///< a facet without any leads to no solution
  std::vector<FacetKind> facet_kinds;  ///< per facet
  std::vector<std::vector<int>> neighbours;  ///< per facet
};

enum class Built {
  kFull,       ///< holds a ball
  kFlat,       ///< holds none of the radius asked for; rows() describe it
  kEmpty,      ///< a constraint excludes every parameter, or the active rows are dependent
  kSaturated,  ///< left out because of MpQpOptions::output
};

class RegionBuilder {
 public:
  /// Both must outlive the builder.
  RegionBuilder(const LeastDistanceForm& form, const MpQpOptions& options);

  /// Fills `region`, its neighbours apart, unless the region is not full-dimensional.
  Built build(const std::vector<int>& active, double least_radius, ExploredRegion& region);
  /// Of the set built last.
  const RegionRows& rows() const { return rows_; }
  /// Factorises an active set for cross(); false if its rows are dependent.
  bool factorise(const std::vector<int>& active);
  /// Appends the active sets beyond the facet of a row, for the set factorised or built last:
  /// an active row leaves; another enters, alone if it is independent of the active ones, else in
  /// exchange for one of them (ratio test of the multipliers, which may come out differently in
  /// different parts of the facet). None: no solution beyond (Farkas).
  void cross(int facet, int label, std::vector<Crossing>& crossings);
  /// Radius of the largest ball, within the plane of a facet, of what `rows` and the facet share.
  double shared_radius(const RegionRows& rows, const Polytope& polytope, int facet, Point& centre);

  double nudge(int row) const { return nudges_[static_cast<std::size_t>(row)]; }
  long lp_count() const { return reducer_.lp_count() + slice_.count(); }

 private:
  template <int kWidth>
  void solve_active_set();
  template <int kWidth>
  bool collect_rows();
  bool output_is_saturated() const;
  bool add(const double* a, double scale, double rounding, int label);
  void settle_labels(Polytope& polytope) const;

  const LeastDistanceForm& form_;
  const MpQpOptions& options_;
  PolytopeReducer reducer_;
  LinearProgram slice_;
  HalfSpaces slice_rows_;
  ActiveRows factor_;
  std::vector<int> active_;
  std::vector<double> nudges_;
  int width_;                       // np + 2, rounded up to a multiple of four
  std::vector<double> data_;        // (D, nudge) of every row, width_ wide
  std::vector<double> z_, lambda_;  // the same for z (n) and the multipliers
  RegionRows rows_;
  std::vector<double> remainder_, coefficients_;
  Eigen::RowVectorXd output_z_, output_q_;  // y = output_z·z + output_q·(q, 1)
};

/// `active` after a crossing.
std::vector<int> crossed(const std::vector<int>& active, const Crossing& crossing);

}  // namespace eampc::law_design
