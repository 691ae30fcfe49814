#include "service/rig_name.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "service/options.hpp"

namespace eampc::service {
namespace {

class RigNameTest : public ::testing::Test {
 protected:
  RigNameTest() { std::filesystem::create_directories(folder_); }
  ~RigNameTest() override { std::filesystem::remove_all(folder_); }
  std::string written(const std::string& text) {
    std::ofstream(folder_ / "rig.toml") << text;
    return folder_.string();
  }
  const std::filesystem::path folder_ =
      std::filesystem::temp_directory_path() / ("rig_name_test_" + std::to_string(::getpid()));
};

TEST_F(RigNameTest, IsReadFromTheTableRigOnly) {
  EXPECT_EQ(read_rig_name(written("[other]\nname = \"no\"\n[rig.more]\nname = \"no\"\n[rig] # the "
                                  "rig\n  name = \"yes\"  # it\n")),
            "yes");
  EXPECT_EQ(read_rig_name((folder_ / "rig.toml").string()), "yes");
}

TEST_F(RigNameTest, MissingFileAndMissingNameAreSentences) {
  EXPECT_THROW(read_rig_name((folder_ / "none").string()), BadInput);
  EXPECT_THROW(read_rig_name(written("[joint]\nname = \"x\"\n")), BadInput);
}

}  // namespace
}  // namespace eampc::service
