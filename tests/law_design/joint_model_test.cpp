#include "law_design/joint_model.hpp"

#include <gtest/gtest.h>

#include "law_design/design_error.hpp"
#include "rig_data.hpp"

namespace eampc::law_design {
namespace {

TEST(JointModel, ReferenceRigByHand) {
  const ContinuousModel model = joint_model(reference_rig());
  // b = 2·0.09·0.45·0.025·(10000·0.01 − 7500·0.1 + 1600)/0.05
  EXPECT_NEAR(model.b, 38.475, 1e-12);
  // b1 = 2·0.09·5·0.025²·(2·10000·0.1 − 7500)/(0.2·0.05)
  EXPECT_NEAR(model.b1, -309.375, 1e-11);
  EXPECT_DOUBLE_EQ(model.b2, -10.0);
  Eigen::Matrix3d A;
  A << 0.0, 1.0, 0.0, -309.375, -10.0, 38.475, 0.0, 0.0, -1.0 / 0.03;
  ASSERT_EQ(model.order(), 3);
  EXPECT_TRUE(model.A.isApprox(A, 1e-14));
  EXPECT_TRUE(model.B.isApprox(Eigen::Vector3d(0.0, 0.0, 1.0 / 0.03), 1e-14));
}

TEST(JointModel, PaperCasesByHand) {
  const ContinuousModel case1 = joint_model(paper_rig(2.0));
  // b = 2·0.09·0.45·0.25·(10·0.01 + 7.5·0.1 + 1.6)/0.05, b1 = 2·0.09·2·0.0625·(2 + 7.5)/0.01
  EXPECT_NEAR(case1.b, 0.99225, 1e-14);
  EXPECT_NEAR(case1.b1, 21.375, 1e-13);
  EXPECT_DOUBLE_EQ(case1.b2, -2.0);
  ASSERT_EQ(case1.order(), 2);
  EXPECT_DOUBLE_EQ(case1.B(1), case1.b);
  const ContinuousModel case2 = joint_model(paper_rig(0.0));
  EXPECT_EQ(case2.b1, 0.0);
  EXPECT_NEAR(case2.A.determinant(), 0.0, 0.0);
}

TEST(JointModel, IdealValvesDropTheThirdState) {
  JointData rig = reference_rig();
  rig.valve_time_constant_s = 0.0;
  const ContinuousModel model = joint_model(rig);
  EXPECT_EQ(model.order(), 2);
  EXPECT_TRUE(model.B.isApprox(model.joint_B()));
  EXPECT_TRUE(model.A.isApprox(model.joint_A()));
}

TEST(JointModel, MusclesWithoutPullAreRefused) {
  JointData rig = reference_rig();
  rig.k3_N_per_MPa = 600.0;  // 100 − 750 + 600 < 0
  EXPECT_THROW(joint_model(rig), DesignError);
}

}  // namespace
}  // namespace eampc::law_design
