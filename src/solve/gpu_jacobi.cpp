#include "solve/gpu_jacobi.h"

#include "base/error.h"
#include "base/machine.h"
#include "shaders/jacobi.comp.WIDE.h"
#include "shaders/jacobi.comp.h"
#include "shared/interface.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <tbb/parallel_for.h>

namespace farol {
namespace {

constexpr uint32_t kPadding = 32;  // columns; whole workgroups of rows, and whole vectors

uint32_t paddedCount(size_t n) { return static_cast<uint32_t>((std::max<size_t>(n, 1) + kPadding - 1) / kPadding * kPadding); }

// IEEE half precision, rounded to nearest; for values of 0 to 2^15. What is below 2^-14 becomes 0.
uint16_t halfOf(float value) {
  const auto bits = std::bit_cast<uint32_t>(value);
  const uint32_t rounded = (bits + 0xFFFu + (bits >> 13 & 1u)) >> 13;
  constexpr uint32_t kBias = (127u - 15u) << 10;
  return static_cast<uint16_t>(rounded < kBias + (1u << 10) ? 0u : rounded - kBias);
}

// A row in half precision, scaled so that its largest entry lies between 2^13 and 2^14: entries down to a 2^27th of it
// keep 11 bits. Returns the scale.
float toHalf(std::span<const float> row, std::span<uint16_t> to) {
  const float most = row.empty() ? 0.0f : *std::max_element(row.begin(), row.end());
  int exponent = 0;
  std::frexp(most, &exponent);
  const float scale = most > 0 ? std::ldexp(1.0f, 14 - exponent) : 1.0f;
  for (size_t j = 0; j < row.size(); ++j) to[j] = halfOf(row[j] * scale);
  return scale;
}

gpu::ComputePipeline pipelineFor(const gpu::Device& device) {
  const bool software = device.info().type == "CPU";
  return {device, "Jacobi sweep", software ? gpu::Spirv(jacobi_comp) : gpu::Spirv(jacobi_comp_WIDE), shader::kJacobiBindingCount,
          sizeof(shader::JacobiPush)};
}

}  // namespace

uint64_t GpuJacobi::bytesFor(size_t patches) { return uint64_t{paddedCount(patches)} * paddedCount(patches) * sizeof(uint16_t); }

GpuJacobi::GpuJacobi(const gpu::Device& device, const FormFactorMatrix& f, const std::vector<size_t>& reflecting,
                     const Channels& reflectance)
    : device_(device),
      reflecting_(reflecting),
      patches_(f.size()),
      padded_(paddedCount(reflecting.size())),
      pipeline_(pipelineFor(device)),
      residual_(device, "residual", 12ull * padded_, gpu::Memory::device),
      reflectance_(device, "reflectance", 12ull * padded_, gpu::Memory::device),
      fields_{{device, "radiosity", 12ull * padded_, gpu::Memory::device},
              {device, "radiosity", 12ull * padded_, gpu::Memory::device}},
      changes_(device, "changes", 4ull * kMostInBatch, gpu::Memory::device),
      upload_(device, "residual (staging)", 12ull * padded_, gpu::Memory::upload),
      download_(device, "radiosity (staging)", 12ull * padded_ + 4ull * kMostInBatch, gpu::Memory::download),
      commands_(device, "Jacobi sweeps") {
  constexpr double kUsableShare = 0.8;
  const uint64_t bytes = bytesFor(reflecting.size());
  if (static_cast<double>(bytes) > kUsableShare * static_cast<double>(device.info().memoryBytes)) {
    throw gpu::OutOfMemory("form factors of {} patches need {:.3g} GB on device {}, which has {:.3g} GB", reflecting.size(),
                           static_cast<double>(bytes) * 1e-9, device.info().name,
                           static_cast<double>(device.info().memoryBytes) * 1e-9);
  }
  const uint64_t rowBytes = uint64_t{padded_} * sizeof(uint16_t);
  constexpr uint64_t kMostStaged = 64u << 20;
  const uint64_t most = std::min(device.limits().maxStorageBufferRange, kMostStaged) / rowBytes;
  const auto rowsPerBlock = static_cast<uint32_t>(std::max<uint64_t>(most / shader::kJacobiRows, 1)) * shader::kJacobiRows;
  gpu::Buffer staging(device, "form factors (staging)", std::min<uint64_t>(rowsPerBlock, padded_) * rowBytes, gpu::Memory::upload);
  std::vector<float> scales(padded_, 1.0f);
  for (uint32_t first = 0; first < padded_; first += rowsPerBlock) {
    const uint32_t rows = std::min(rowsPerBlock, padded_ - first);
    const std::span<uint16_t> to = staging.as<uint16_t>();
    tbb::parallel_for(uint32_t{0}, rows, [&](uint32_t k) {
      const std::span<uint16_t> row = to.subspan(size_t{k} * padded_, padded_);
      std::fill(row.begin(), row.end(), uint16_t{0});
      if (first + k >= reflecting.size()) return;
      const FormFactorRow from = f[reflecting[first + k]];
      std::vector<float> values(from.dense.begin(), from.dense.end());
      if (values.empty()) values = from.expanded();
      for (size_t l = 0; l < reflecting.size(); ++l) values[l] = values[reflecting[l]];
      scales[first + k] = toHalf(std::span(values).first(reflecting.size()), row);
    });
    gpu::Buffer factors(device, "form factors", rows * rowBytes, gpu::Memory::device);
    commands_.begin();
    commands_.copy(staging, factors, rows * rowBytes);
    commands_.submit();
    commands_.wait();
    Block block{first, rows, std::move(factors), {}};
    for (const size_t from : {size_t{0}, size_t{1}}) {
      block.bindings.emplace_back(device, "Jacobi sweep",
                                  std::vector<const gpu::Buffer*>{&block.factors, &fields_[from], &fields_[1 - from], &residual_,
                                                                  &reflectance_, &changes_});
    }
    blocks_.push_back(std::move(block));
  }
  Channels scaled = reflectance;
  for (size_t k = 0; k < reflecting.size(); ++k)
    scaled.row(static_cast<Eigen::Index>(reflecting[k])) /= static_cast<double>(scales[k]);
  put(scaled, 1, reflectance_);
}

// The reflecting patches' values over `scale`, padded with zeros.
void GpuJacobi::put(const Channels& values, double scale, const gpu::Buffer& to) {
  const auto staged = upload_.as<float>();
  std::fill(staged.begin(), staged.end(), 0.0f);
  for (size_t c = 0; c < 3; ++c) {
    for (size_t k = 0; k < reflecting_.size(); ++k) {
      const auto i = static_cast<Eigen::Index>(reflecting_[k]);
      staged[c * padded_ + k] = static_cast<float>(values(i, static_cast<Eigen::Index>(c)) / scale);
    }
  }
  commands_.begin();
  commands_.copy(upload_, to, 12ull * padded_);
  commands_.submit();
  commands_.wait();
}

void GpuJacobi::sweep(uint32_t count) {
  commands_.begin();
  commands_.fill(changes_, 4ull * kMostInBatch, 0);
  for (uint32_t s = 0; s < count; ++s) {
    for (const Block& block : blocks_) {
      commands_.bind(pipeline_, block.bindings[current_]);
      commands_.push(shader::JacobiPush{padded_, block.firstRow, s, 0});
      commands_.dispatch(block.rows / shader::kJacobiRows, 1);
    }
    current_ = 1 - current_;
  }
  commands_.copy(changes_, download_, 4ull * kMostInBatch);
  commands_.submit();
  commands_.wait();
}

Reflections GpuJacobi::reflections(const Channels& r, double goal, size_t mostSweeps) {
  Reflections result{Channels::Zero(static_cast<Eigen::Index>(patches_), 3), {}};
  const double scale = largest(r);  // keeps float32 away from its smallest numbers
  result.changes.push_back(scale);
  put(r, scale, residual_);
  put(r, scale, fields_[current_]);

  // Half precision does not know F well enough for more: the next correction takes what is left.
  constexpr double kFloor = 3e-5, kWellBelow = 0.3;
  for (bool more = mostSweeps > 1; more;) {
    const auto count = static_cast<uint32_t>(std::min<size_t>(batch_, mostSweeps - result.changes.size()));
    const Stopwatch watch;
    sweep(count);
    size_.took(count, watch.seconds());
    const auto bits = download_.as<uint32_t>();
    for (uint32_t s = 0; s < count; ++s) result.changes.push_back(scale * static_cast<double>(std::bit_cast<float>(bits[s])));
    const double missing = sweepsMissing(result.changes, std::max(kWellBelow * goal, kFloor * scale));
    more = missing > 0 && result.changes.size() < mostSweeps;
    batch_ = static_cast<uint32_t>(std::clamp(missing, 1.0, static_cast<double>(size_.now())));
  }
  commands_.begin();
  commands_.copy(fields_[current_], download_, 12ull * padded_);
  commands_.submit();
  commands_.wait();
  const auto found = download_.as<float>();
  for (size_t c = 0; c < 3; ++c) {
    for (size_t k = 0; k < reflecting_.size(); ++k) {
      const auto i = static_cast<Eigen::Index>(reflecting_[k]), channel = static_cast<Eigen::Index>(c);
      result.sum(i, channel) = scale * static_cast<double>(found[c * padded_ + k]) - r(i, channel);
    }
  }
  return result;
}

}  // namespace farol
