// The name of a rig as its rig.toml states it: the daemon's check that law and rig belong together.
#pragma once

#include <string>

namespace eampc::service {

// `path` is the folder or the file. Reads only `name = "…"` in the table [rig]. Throws BadInput.
std::string read_rig_name(const std::string& path);

}  // namespace eampc::service
