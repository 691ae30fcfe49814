// What the offline design throws: one sentence with what is wrong, where, and what to change.
#pragma once

#include <stdexcept>

namespace eampc::law_design {

class DesignError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace eampc::law_design
