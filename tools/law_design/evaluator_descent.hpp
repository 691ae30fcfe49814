// One region on its way through the evaluator: the leaves it reaches, and the proof in each.
// See evaluator_certificate.hpp for what is proved.
#pragma once

#include <vector>

#include "law_design/law_in_tables.hpp"
#include "law_design/linear_program.hpp"
#include "law_design/region_certificate.hpp"
#include "service/law_tables.hpp"

namespace eampc::law_design {

class EvaluatorDescent {
 public:
  /// A region that reaches less than this beyond a hyperplane is on one side of it.
  static constexpr double kSide = 2e-11;

  EvaluatorDescent(const service::LawTables& tables, const LawInTables& law, double tolerance);

  struct Result {
    long cells = 0;
    long wrong_cells = 0;
    double error = 0.0;  ///< proved bound; 1 if the value may be anything
    bool unmatched = false;
    int wrong_leaf = -1;
  };
  Result check(const CertifiedRegion& region);

  long lp_count() const { return program_.count(); }

 private:
  void start(const HalfSpaces& facets, const AffineForm& output);
  void enter_tree(std::int32_t code, std::vector<Point> points);
  void enter_plane(std::int32_t node, int at, unsigned path, std::vector<Point> points);
  void enter_flat(std::uint64_t known, std::uint64_t above, std::vector<Point> points);
  void reach(int leaf);
  /// Bit 0: has points below the plane; bit 1: above. Adds the points it finds.
  unsigned sides(const double* normal, double offset, std::vector<Point>& points);
  template <typename Go>
  void split(int plane, const std::vector<Point>& points, const Go& go);
  bool leaf_is_right(int leaf, double tolerance);
  bool too_high(int term, double tolerance);
  bool too_low(std::vector<int>& terms, std::size_t at, double tolerance);
  bool same_law(int piece, double tolerance) const;
  /// True if no point of the cell satisfies the extra rows as well.
  bool no_point(const AffineForm& objective, double cutoff);
  /// Adds form·(q, 1) ≥ 0 to the extra rows; false if no point of the box satisfies it.
  bool require_form(const AffineForm& form);
  double support(const AffineForm& form);

  const service::LawTables& tables_;
  const LawInTables& law_;
  double tolerance_;
  int np_;
  LinearProgram program_;
  const HalfSpaces* facets_ = nullptr;
  HalfSpaces cell_, extra_, mirrored_;
  AffineForm output_{};
  double output_low_ = 0.0, output_high_ = 0.0;  // of the region's law, not clipped
  Point lower_{}, upper_{};
  Result result_;
};

}  // namespace eampc::law_design
