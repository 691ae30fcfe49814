// Exploration of the critical regions of a problem in least-distance form, by crossing facets.
#pragma once

#include <Eigen/Dense>
#include <functional>
#include <unordered_map>
#include <vector>

#include "law_design/least_distance_form.hpp"
#include "law_design/mpqp.hpp"
#include "law_design/polytope.hpp"
#include "law_design/quadratic_program.hpp"

namespace eampc::law_design {

struct ExploredRegion {
  std::vector<int> active;         ///< rows of the least-distance form, ascending
  LeastDistanceForm::RowMatrix z;  ///< z = z·(q, 1), n×(np+1)
  Polytope polytope;               ///< in q; labels are rows of the form, kBoxLabel or below
  std::vector<FacetKind> facet_kinds;        ///< per facet
  std::vector<std::vector<int>> neighbours;  ///< per facet
};

class RegionExplorer {
 public:
  RegionExplorer(const LeastDistanceForm& form, const MpQpOptions& options);

  /// Explores until every facet has been crossed and the closure checks find nothing new.
  void run();

  const std::vector<ExploredRegion>& regions() const { return regions_; }
  const MpQpStatistics& statistics() const { return statistics_; }

 private:
  struct ActiveSetHash {
    std::size_t operator()(const std::vector<int>& active) const;
  };
  enum class Built { kFull, kFlat, kEmpty };

  /// z = z(q, 1) and the multipliers on an active set; false if its rows are dependent.
  bool solve_active_set(const std::vector<int>& active);
  bool output_is_saturated() const;
  Built build(const std::vector<int>& active, double least_radius, ExploredRegion& region);
  /// Index of the region of this active set, built on first sight; kFlatRegion if it has none.
  int region_of(const std::vector<int>& active);
  int adopt(ExploredRegion&& region);
  /// Index of some region that holds q, or -1.
  int region_holding(const double* q) const;
  void cross(int region, int facet, const Point& on_facet, bool first);
  void cross_by(int region, int facet, const Point& on_facet, double step, bool first);
  /// Deals with a point whose active set has no full-dimensional region. True if `region`'s law is
  /// proved good enough there.
  bool accept_flat(const std::vector<int>& active, int region, int facet, const Point& q);
  void link(int region, int facet, int neighbour);
  void explore_queue();
  bool check_closure();
  bool check_random_points();
  void report();

  const LeastDistanceForm& form_;
  const MpQpOptions& options_;
  MpQpStatistics statistics_;
  LeastDistanceProgram program_;
  PolytopeReducer reducer_;
  ActiveRows factor_;
  std::vector<ExploredRegion> regions_;
  std::unordered_map<std::vector<int>, int, ActiveSetHash> known_;
  std::size_t next_ = 0;    // first region whose facets have not been crossed
  std::size_t closed_ = 0;  // first region whose facets have not been closed
  std::vector<double> right_side_, right_side_of_active_;
  Eigen::MatrixXd z_, lambda_;              // of the last active set solved
  Eigen::RowVectorXd output_z_, output_q_;  // y = output_z·z + output_q·(q, 1)
  HalfSpaces region_rows_;
  std::vector<int> region_labels_;
};

}  // namespace eampc::law_design
