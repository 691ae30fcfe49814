#include "service/rig_name.hpp"

#include <filesystem>
#include <fstream>
#include <regex>

#include "service/options.hpp"

namespace eampc::service {

std::string read_rig_name(const std::string& path) {
  std::filesystem::path file(path);
  if (std::filesystem::is_directory(file)) file /= "rig.toml";
  std::ifstream stream(file);
  if (!stream) throw BadInput("cannot read the rig file " + file.string() + "; check --rig");
  static const std::regex table(R"(^\s*\[([^\]]*)\]\s*(#.*)?$)");
  static const std::regex name(R"re(^\s*name\s*=\s*"([^"]*)"\s*(#.*)?$)re");
  bool in_rig = false;
  std::smatch match;
  for (std::string line; std::getline(stream, line);) {
    if (std::regex_match(line, match, table)) {
      in_rig = match[1] == "rig";
    } else if (in_rig && std::regex_match(line, match, name)) {
      return match[1];
    }
  }
  throw BadInput(file.string() + ": there is no line name = \"...\" in the table [rig]");
}

}  // namespace eampc::service
