// Jacobi sweeps in a compute shader. Internal to this room and its benchmark.
#pragma once

#include "gpu/batch_size.h"
#include "gpu/gpu.h"
#include "solve/system.h"

namespace farol {

// F between the reflecting patches, in half precision, in blocks of rows that a device can bind; sweeps in float32 are
// submitted in batches and tell their largest changes. What half precision lacks, the caller's residual in double from
// the F that counts brings back: the solution is that F's. Throws gpu::OutOfMemory when the device has too little
// of it.
class GpuJacobi {
 public:
  GpuJacobi(const gpu::Device& device, const FormFactorMatrix& f, const std::vector<size_t>& reflecting,
            const Channels& reflectance);

  // Until what the remaining sweeps would add is well below `goal`, or changes have stopped to shrink. Of reflecting
  // patches only.
  Reflections reflections(const Channels& r, double goal, size_t mostSweeps);

  // Of F on the device.
  static uint64_t bytesFor(size_t patches);

  void sweep(uint32_t count);  // one submission; leaves the largest changes in download_

 private:
  void put(const Channels& values, double scale, const gpu::Buffer& to);

  const gpu::Device& device_;
  const std::vector<size_t>& reflecting_;
  size_t patches_;
  uint32_t padded_;  // reflecting patches, padded to whole workgroups
  struct Block {
    uint32_t firstRow, rows;
    gpu::Buffer factors;
    std::vector<gpu::Bindings> bindings;  // from the first field to the second, and back
  };
  gpu::ComputePipeline pipeline_;
  gpu::Buffer residual_, reflectance_, fields_[2], changes_, upload_, download_;  // fields: [3 x padded]
  std::vector<Block> blocks_;
  gpu::Commands commands_;
  uint32_t current_ = 0;  // the field that holds the newest sum
  static constexpr uint32_t kMostInBatch = 64;
  gpu::BatchSize size_{4, 1, kMostInBatch};  // sweeps per submission, at most
  uint32_t batch_ = size_.now();             // and in the next one
};

}  // namespace farol
