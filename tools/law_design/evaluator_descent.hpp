// One region on its way through the evaluator: the leaves it reaches, and the proof in each.
// See evaluator_certificate.hpp for what is proved.
#pragma once

#include <vector>

#include "law_design/certificate_problem.hpp"
#include "law_design/double_arena.hpp"
#include "law_design/extended_program.hpp"
#include "law_design/law_in_tables.hpp"
#include "law_design/leaf_proof.hpp"
#include "law_design/linear_program.hpp"
#include "law_design/quick_leaf_proof.hpp"
#include "law_design/region_certificate.hpp"
#include "service/law_tables.hpp"

namespace eampc::law_design {

/// The arena in extended precision.
struct ExtendedArena {
  using Form = ExtendedForm;
  explicit ExtendedArena(int dimension) : program(dimension) {}
  int size() const { return static_cast<int>(rows.size()); }
  void cut(int size) { rows.resize(static_cast<std::size_t>(size)); }
  void add(const Form& form) { rows.push_back(form); }
  bool below(const Form& form, long double limit);

  ExtendedProgram program;
  std::vector<ExtendedForm> facets, cell, rows;
};

class EvaluatorDescent {
 public:
  /// A region that reaches less than this beyond a hyperplane is on one side of it.
  static constexpr double kSide = 2e-11;
  /// Where the points in error hold no ball of this radius, the error may be kSliverError.
  static constexpr double kSliver = 1e-9;
  static constexpr double kSliverError = 1e-6;

  EvaluatorDescent(const CertificateProblem& problem, const service::LawTables& tables,
                   const LawInTables& law, double tolerance, bool quick);

  struct Result {
    long cells = 0;
    long wrong_cells = 0;
    long decided_again = 0;  ///< questions that needed extended precision
    double error = 0.0;      ///< proved bound; 1 if the value may be anything
    long slivers = 0;        ///< cells whose points in error hold no ball of radius kSliver,
    double sliver_error = 0.0, sliver_radius = 0.0;  ///< … their bound, and the ball
    bool unmatched = false;
    int wrong_leaf = -1;
  };
  Result check(const CertifiedRegion& region);

  long lp_count() const { return arena_.program.count(); }

 private:
  void start(const HalfSpaces& facets, const AffineForm& output);
  void enter_tree(std::int32_t code, std::vector<Point> points);
  void enter_plane(std::int32_t node, int at, unsigned path, std::vector<Point> points);
  void enter_flat(std::uint64_t known, std::uint64_t above, std::vector<Point> points);
  void reach(int leaf, const std::vector<Point>& points);
  /// Bit 0: has points below the plane; bit 1: above. Adds the points it finds.
  unsigned sides(const double* normal, double offset, std::vector<Point>& points);
  template <typename Go>
  void split(int plane, const std::vector<Point>& points, const Go& go);
  bool leaf_is_right(int leaf, double tolerance);
  void load_extended();
  double support(const AffineForm& form);

  const service::LawTables& tables_;
  const LawInTables& law_;
  double tolerance_;
  int np_;
  RegionCertifier certifier_;
  DoubleArena arena_;
  ExtendedArena extended_;
  QuickLeafProof quick_;
  bool quick_used_;
  std::vector<ExtendedForm> extended_cell_;
  ExtendedForm extended_output_{};
  bool extended_loaded_ = false;
  const CertifiedRegion* region_ = nullptr;
  bool mirrored_half_ = false;
  const HalfSpaces* facets_ = nullptr;
  HalfSpaces mirrored_;
  AffineForm output_{};
  double output_low_ = 0.0, output_high_ = 0.0;  // of the region's law, not clipped
  Point lower_{}, upper_{};
  Result result_;
};

}  // namespace eampc::law_design
