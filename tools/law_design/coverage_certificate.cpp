#include "law_design/coverage_certificate.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <memory>
#include <random>
#include <utility>

#include "law_design/facet_walk.hpp"
#include "law_design/polytope_volume.hpp"

namespace eampc::law_design {
namespace {

using Kind = FacetWalkResult::Kind;

// A generic point keeps this distance from every facet.
constexpr double kGeneric = 1e-9;
// Sum of the volumes of the regions, of the box's.
constexpr double kVolume = 1e-9;

std::size_t index(int i) { return static_cast<std::size_t>(i); }

// What the facets of one region contributed.
struct RegionCoverage {
  long facets = 0, matched = 0, walked = 0, infeasible = 0, failed = 0, slivers = 0;
  double plane_mismatch = 0.0, law_mismatch = 0.0, jump = 0.0, gap_radius = 0.0;
  std::string failure;
  std::vector<CertifiedRegion> gaps;
};

RegionCoverage cross_facets(FacetWalk& walk, const CertifiedRegion& region, int id,
                            bool infeasible_allowed) {
  RegionCoverage c;
  for (int f = 0; f < region.polytope.facets.size(); ++f) {
    FacetWalkResult beyond = walk.cross(id, f);
    ++c.facets;
    if (beyond.kind == Kind::kInfeasible && !infeasible_allowed) {
      beyond.kind = Kind::kFailed;
      beyond.failure = "parameters beyond a facet have no solution, and the law must have one";
    }
    c.matched += beyond.kind == Kind::kMatched ? 1 : 0;
    c.walked += beyond.kind == Kind::kWalked ? 1 : 0;
    c.infeasible += beyond.kind == Kind::kInfeasible ? 1 : 0;
    c.failed += beyond.kind == Kind::kFailed ? 1 : 0;
    c.slivers += beyond.slivers;
    c.plane_mismatch = std::max(c.plane_mismatch, beyond.plane_mismatch);
    c.law_mismatch = std::max(c.law_mismatch, beyond.law_mismatch);
    c.jump = std::max(c.jump, beyond.jump);
    c.gap_radius = std::max(c.gap_radius, beyond.gap_radius);
    if (c.failure.empty()) c.failure = beyond.failure;
    for (CertifiedRegion& gap : beyond.gaps) c.gaps.push_back(std::move(gap));
  }
  return c;
}

// How many regions hold q, or -1 if q is too near a facet of one to tell.
int holders(const std::vector<CertifiedRegion>& regions, const double* q) {
  int count = 0;
  for (const CertifiedRegion& region : regions) {
    if (!region.polytope.facets.contains(q, kGeneric)) continue;
    if (!region.polytope.facets.contains(q, -kGeneric)) return -1;
    ++count;
  }
  return count;
}

std::string check_generic_points(const CertificateProblem& problem,
                                 const std::vector<CertifiedRegion>& regions,
                                 const CoverageOptions& options, CoverageCertificate& result) {
  std::mt19937 random(options.seed);
  const auto draw = [&] { return 2.0 * static_cast<double>(random()) / 4294967295.0 - 1.0; };
  Point q{};
  for (int i = 0; i < 50 * options.generic_points; ++i) {
    if (result.generic_points == options.generic_points) break;
    for (int j = 0; j < problem.parameters; ++j) q[index(j)] = draw();
    const int held = holders(regions, q.data());
    if (held < 0 || (held == 0 && options.infeasible_allowed)) continue;
    if (held != 1) {
      return std::to_string(held) + " regions hold the same generic point, not one";
    }
    ++result.generic_points;
  }
  // With most of the box infeasible: centres of regions, which one region holds at least.
  for (const CertifiedRegion& region : regions) {
    if (result.generic_points > 0) break;
    const int held = holders(regions, region.polytope.centre.data());
    if (held > 1) return "two regions overlap";
    if (held == 1) ++result.generic_points;
  }
  return result.generic_points > 0 ? "" : "no generic point is held by exactly one region";
}

}  // namespace

CoverageCertificate certify_coverage(const CertificateProblem& problem,
                                     const std::vector<CertifiedRegion>& regions,
                                     const CoverageOptions& options, const LoopProgress& progress) {
  CoverageCertificate result;
  const int count = static_cast<int>(regions.size());
  ActiveSetIndex known;
  known.reserve(regions.size());
  for (int r = 0; r < count; ++r) {
    if (!known.emplace(regions[index(r)].independent, r).second) ++result.duplicates;
  }
  std::vector<std::unique_ptr<FacetWalk>> walks;
  for (int t = 0; t < options.threads; ++t) {
    walks.push_back(std::make_unique<FacetWalk>(problem, regions, known));
  }
  std::vector<RegionCoverage> parts(regions.size());
  parallel_range(
      count, options.threads,
      [&](int r, int thread) {
        if (!regions[index(r)].solved) return;
        parts[index(r)] =
            cross_facets(*walks[index(thread)], regions[index(r)], r, options.infeasible_allowed);
      },
      progress);

  std::map<std::vector<int>, CertifiedRegion> gaps;
  for (RegionCoverage& part : parts) {
    result.facets += part.facets;
    result.matched += part.matched;
    result.walked += part.walked;
    result.infeasible_border += part.infeasible;
    result.uncovered += part.failed;
    result.slivers += part.slivers;
    result.plane_mismatch = std::max(result.plane_mismatch, part.plane_mismatch);
    result.law_mismatch = std::max(result.law_mismatch, part.law_mismatch);
    result.jump = std::max(result.jump, part.jump);
    result.largest_gap = std::max(result.largest_gap, part.gap_radius);
    if (result.failure.empty()) result.failure = part.failure;
    for (CertifiedRegion& gap : part.gaps) gaps.emplace(gap.independent, std::move(gap));
  }
  for (auto& [active, gap] : gaps) {
    RegionCertifier certifier(problem);
    certifier.certify(active, 0.0, gap);
    result.gap_regions.push_back(std::move(gap));
  }
  for (const auto& walk : walks) result.lps += walk->lp_count();
  if (result.duplicates > 0 && result.failure.empty()) {
    result.failure = "an active set is listed twice";
  }
  const std::string generic = check_generic_points(problem, regions, options, result);
  if (result.failure.empty()) result.failure = generic;
  if (problem.parameters <= kMostVolumeDimensions) {
    double volume = 0.0;
    for (const CertifiedRegion& region : regions) {
      if (region.solved) volume += polytope_volume(region.polytope.facets);
    }
    result.volume = volume / std::exp2(problem.parameters);
    if (result.failure.empty() && result.infeasible_border == 0 &&
        std::abs(result.volume - 1.0) > kVolume) {
      result.failure = "the volumes of the regions do not add up to the box's";
    }
  }
  result.proved = result.failure.empty();
  return result;
}

}  // namespace eampc::law_design
