// Several row makers as one: rows are handed out in chunks, each maker works on a thread of its own.
#pragma once

#include "formfactor/form_factors.h"

#include <memory>
#include <vector>

namespace farol {

// A software Vulkan device transforms and bins triangles on one thread: two such devices side by side make 1.3 to
// 1.5 times the rows of one on two cores. A row does not depend on which maker makes it.
class TeamRowMaker : public RowMaker {
 public:
  // At least one maker; `chunk` patches are handed out at a time.
  TeamRowMaker(std::vector<std::unique_ptr<RowMaker>> makers, size_t chunk);

  // Calls `done` on the calling thread only. An exception from a maker or from `done` ends all work and is passed on.
  void makeRows(std::span<const uint32_t> patches, RowStore& store, const std::function<void(size_t)>& done) override;

 private:
  std::vector<std::unique_ptr<RowMaker>> makers_;
  size_t chunk_;
};

}  // namespace farol
