#include "service/rig_name.hpp"

#include <filesystem>
#include <fstream>
#include <string_view>

#include "service/options.hpp"

namespace eampc::service {
namespace {

std::string_view without_spaces(std::string_view text) {
  constexpr std::string_view kSpaces = " \t\r";
  const std::size_t first = text.find_first_not_of(kSpaces);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kSpaces) - first + 1);
}

}  // namespace

std::string read_rig_name(const std::string& path) {
  std::filesystem::path file(path);
  if (std::filesystem::is_directory(file)) file /= "rig.toml";
  std::ifstream stream(file);
  if (!stream) throw BadInput("cannot read the rig file " + file.string() + "; check --rig");
  bool in_rig = false;
  for (std::string text; std::getline(stream, text);) {
    const std::string_view line = without_spaces(text);
    if (line.starts_with('[')) {
      in_rig = without_spaces(line.substr(1, line.find(']') - 1)) == "rig";
      continue;
    }
    const std::size_t equals = line.find('=');
    if (!in_rig || equals == std::string_view::npos) continue;
    const std::string_view value = without_spaces(line.substr(equals + 1));
    const std::size_t end = value.find('"', 1);
    if (without_spaces(line.substr(0, equals)) == "name" && value.starts_with('"') &&
        end != std::string_view::npos) {
      return std::string(value.substr(1, end - 1));
    }
  }
  throw BadInput(file.string() + ": there is no line name = \"...\" in the table [rig]");
}

}  // namespace eampc::service
