// The evaluation of point_location.hpp as compiled for each instruction set; avx2 and avx512 on
// x86-64 only. Whether the processor has it is for the caller to ask.
#pragma once

#include "control/point_location.hpp"

namespace eampc::control::paths {

PackedLaw::Function scalar(int n_parameters, LawShape shape) noexcept;
PackedLaw::Function vector128(int n_parameters, LawShape shape) noexcept;
PackedLaw::Function avx2(int n_parameters, LawShape shape) noexcept;
PackedLaw::Function avx512(int n_parameters, LawShape shape) noexcept;

}  // namespace eampc::control::paths
