// Evaluates a law at given points, each in one call of evaluate_once: for an instruction counter.
//   law_instructions FILE.law POINTS PATH      POINTS: rows of np doubles; PATH: scalar, avx2, best
//   …
#include <cstdio>
#include <cstring>
#include <exception>
#include <fstream>
#include <iterator>
#include <vector>

#include "service/law_file.hpp"

namespace {

using eampc::control::LawValue;
using eampc::control::PackedLaw;

double sum = 0.0;

}  // namespace

// Named for the counter; what it does besides the evaluation is a few instructions.
extern "C" __attribute__((noinline)) void evaluate_once(const PackedLaw& law, const double* p) {
  const LawValue value = evaluate(law, p);
  sum += value.u + value.piece;
}

int main(int count, char** arguments) try {
  if (count != 4) {
    std::fputs("usage: law_instructions FILE.law POINTS PATH\n", stderr);
    return 2;
  }
  const auto law =
      eampc::service::LawFile::load(arguments[1], eampc::service::evaluation_path(arguments[3]));
  const PackedLaw& packed = law.config().law.packed;
  std::ifstream file(arguments[2], std::ios::binary);
  const std::vector<char> bytes(std::istreambuf_iterator<char>(file), {});
  std::vector<double> points(bytes.size() / sizeof(double));
  std::memcpy(points.data(), bytes.data(), points.size() * sizeof(double));
  const auto np = static_cast<std::size_t>(packed.n_parameters);
  for (std::size_t at = 0; at + np <= points.size(); at += np) {
    evaluate_once(packed, points.data() + at);
  }
  std::printf("%zu points, sum %g\n", points.size() / np, sum);
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "law_instructions: %s\n", error.what());
  return 2;
}
