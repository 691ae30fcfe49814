#include "law_design/extended_program.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace eampc::law_design {
namespace {

using Form = ExtendedForm;

// Unit rows of two coordinates, −sin t·x + cos t·y ≤ b.
Form row(long double t, long double b) {
  Form form{};
  form[0] = std::sin(t);
  form[1] = -std::cos(t);
  form[2] = b;
  return form;
}

bool below(const std::vector<Form>& rows, const Form& objective, long double cutoff) {
  std::vector<const Form*> all;
  for (const Form& form : rows) all.push_back(&form);
  ExtendedProgram program(2);
  return program.below(all, objective, cutoff);
}

// Two rows 1e-9 apart in direction meet in the origin: y ≤ 1e-9·x, −y ≤ 0, so x ≥ 0 …
TEST(ExtendedProgram, SeesAroundTheCornerOfTwoNearlyParallelRows) {
  const std::vector<Form> wedge = {row(1e-9L, 0.0L), {0.0L, 1.0L, 0.0L}};
  Form left{};
  left[0] = -1.0L;
  EXPECT_TRUE(below(wedge, left, 1e-9L));
  EXPECT_FALSE(below(wedge, left, -1e-9L));
  Form up{};
  up[1] = 1.0L;
  EXPECT_TRUE(below(wedge, up, 1.0000001e-9L));
  EXPECT_FALSE(below(wedge, up, 0.9999999e-9L));
}

// … and with −y ≤ −2e-9 nothing is left of the box, with −y ≤ −0.5e-9 half of it.
TEST(ExtendedProgram, TellsAnEmptyWedgeFromAThinOne) {
  const Form any = {1.0L, 0.3L, 0.0L};
  EXPECT_TRUE(below({row(1e-9L, 0.0L), {0.0L, 1.0L, -2e-9L}}, any, -1.9L));
  EXPECT_FALSE(below({row(1e-9L, 0.0L), {0.0L, 1.0L, -0.5e-9L}}, any, 0.9999L));
}

// Rows equal to the last digit but for their bounds: a contradiction of 1e-15 is one, none is none.
TEST(ExtendedProgram, ProvesSmallContradictionsOnly) {
  const Form any = {1.0L, 0.3L, 0.0L};
  const auto against = [&](long double gap) {
    Form other = row(0.7L, 0.2L);
    for (long double& c : other) c = -c;
    other[2] -= gap;
    return below({row(0.7L, 0.2L), other}, any, -1.9L);
  };
  EXPECT_TRUE(against(1e-15L));
  EXPECT_FALSE(against(0.0L));
  EXPECT_FALSE(against(-1e-15L));
}

}  // namespace
}  // namespace eampc::law_design
