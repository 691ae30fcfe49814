// Exploration of the critical regions of a problem in least-distance form, by crossing facets.
//
// A facet is shared exactly with the regions that RegionBuilder::cross names: on its plane the
// solutions and multipliers of both sides agree, so what one side's constraints leave of the plane
// the other side's leave too. Nothing has to be sampled for that. Active sets whose region is flat
// are walked through: their facet on the same plane leads on. What rounding leaves open (slivers)
// is stepped across and judged by how far the solution can be wrong there, or reported.
//
// In rounds: the sets beyond the facets of all regions found so far are listed in order, built by
// all threads, and adopted in order. So the result is the same for any number of threads.
#pragma once

#include <Eigen/Dense>
#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <unordered_map>
#include <vector>

#include "law_design/least_distance_form.hpp"
#include "law_design/mpqp.hpp"
#include "law_design/polytope.hpp"
#include "law_design/quadratic_program.hpp"
#include "law_design/region_builder.hpp"

namespace eampc::law_design {

class RegionExplorer {
 public:
  RegionExplorer(const LeastDistanceForm& form, const MpQpOptions& options,
                 std::chrono::steady_clock::time_point start);

  /// Explores until every facet has been crossed and seeded random points find nothing new.
  void run();

  std::vector<ExploredRegion>& regions() { return regions_; }
  const MpQpStatistics& statistics() const { return statistics_; }
  /// Where the first unresolved point lies, in q.
  const Point& unresolved_at() const { return unresolved_at_; }
  /// How much the solution of the best region found near it differs there, as a share of the
  /// largest solution; infinite if none was found.
  double unresolved_jump() const { return unresolved_jump_; }

 private:
  struct ActiveSetHash {
    std::size_t operator()(const std::vector<int>& active) const;
  };
  /// An active set that has been seen.
  struct SeenSet {
    const std::vector<int>* active = nullptr;
    Built built = Built::kEmpty;
    int region = -1;                   ///< if full
    std::unique_ptr<RegionRows> rows;  ///< if flat
  };
  /// A set reached from a facet of a region, perhaps through flat ones.
  struct Step {
    int region, facet, seen, depth;
    int sliver = -1;  // a set on the way that is not flat but too thin to keep, left …
    Point at{};       // … by the ray from here
  };
  struct FacetOutcome {
    bool saturated = false, infeasible = false, failed = false;
    int sliver = -1;  // because of this set
    Point at{};       // where it failed
  };

  /// Index in seen_, listed for building if new.
  int see(std::vector<int> active);
  int see_and_build(std::vector<int> active);
  void build_listed();
  void adopt(ExploredRegion&& region, SeenSet& seen);
  void explore_round();
  void take(const Step& step, FacetOutcome& outcome, std::vector<Step>& further);
  void walk_through(const Step& step, FacetOutcome& outcome, std::vector<Step>& further);
  int exit_of_ray(const RegionRows& rows, const HalfSpaces& facets, int facet,
                  const Point& from) const;
  bool shares_plane(int region, int facet, int other) const;
  void link(int region, int facet, int neighbour);
  void settle(int region, int facet, const FacetOutcome& outcome);
  void step_across(int region, int facet, const Point& middle);
  bool adopt_thin(int seen);
  double jump(int region, int other, const Point& q) const;
  bool pass_over(int region, int facet, int other, const Point& q);
  void unresolved(const Point& q);
  QpStatus solve_at(const Point& q, double nudge, std::vector<int>& active);
  void find_first_region();
  int walk_to(const double* q, int start) const;
  int region_holding(const double* q) const;
  bool check_random_points();
  void link_both_ways();
  bool report(bool now);

  const LeastDistanceForm& form_;
  const MpQpOptions& options_;
  const std::chrono::steady_clock::time_point start_;
  std::chrono::steady_clock::time_point reported_;
  int threads_;
  MpQpStatistics statistics_;
  LeastDistanceProgram program_;
  std::vector<std::unique_ptr<RegionBuilder>> builders_;  // one per thread
  std::vector<ExploredRegion> regions_;
  std::unordered_map<std::vector<int>, int, ActiveSetHash> known_;
  std::vector<SeenSet> seen_;
  std::vector<int> listed_;
  std::size_t next_ = 0;  // first region whose facets have not been crossed
  std::vector<double> right_side_;
  Point unresolved_at_{};
  double refused_jump_ = 0.0, unresolved_jump_ = 0.0;
};

}  // namespace eampc::law_design
