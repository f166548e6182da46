// A reference kept beside what was measured against it: text, one line per patch.
#pragma once

#include "reference/gathering.h"

#include <string>

namespace farol {

// `key`: a number that changes with everything that the reference depends on.
void writeReference(const std::string& path, uint64_t key, const std::vector<GatheredIrradiance>& sets);

// None where there is no such file, or it has another key or another form.
std::optional<std::vector<GatheredIrradiance>> readReference(const std::string& path, uint64_t key);

}  // namespace farol
