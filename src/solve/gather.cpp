#include "solve/gather.h"

#include <cstring>
#include <type_traits>

namespace farol {
namespace {

// Loops are written once, in vectors that the compiler maps to what each processor has, and compiled for three of them.
// Partial sums are added in one order: neither the number of rows nor, where multiply and add are fused, the instruction
// set changes a bit.
constexpr size_t kLanes = 8;
template <typename Number, size_t Count>
using Vector [[gnu::vector_size(Count * sizeof(Number))]] = Number;
using Lanes = Vector<double, kLanes>;

template <typename From>
[[gnu::always_inline]] inline void load(const From* from, Lanes& to) {
  Vector<From, kLanes> values;
  std::memcpy(&values, from, sizeof values);
  if constexpr (std::is_same_v<From, uint16_t>)  // by way of int, for which there are instructions
    to = __builtin_convertvector(__builtin_convertvector(values, Vector<int32_t, kLanes>), Lanes);
  else
    to = __builtin_convertvector(values, Lanes);
}

// Adds what j below `last`, a multiple of the lanes, bring. Eight rows at once are more than processors fetch ahead by themselves.
template <size_t Channels, typename Factor, size_t Rows>
[[gnu::always_inline]] inline void denseLoop(const Factor* const* rows, const double* b, size_t n, size_t last, Lanes (*sums)[Channels]) {
  constexpr size_t kAhead = 128, kPerLine = 64 / sizeof(Factor);
  Lanes part[Rows][Channels];
  std::memcpy(part, sums, sizeof part);
  for (size_t j = 0; j < last; j += kLanes) {
    Lanes from[Channels], f;
    for (size_t c = 0; c < Channels; ++c) load(b + c * n + j, from[c]);
    for (size_t r = 0; r < Rows; ++r) {
      load(rows[r] + j, f);
      if (j % kPerLine == 0) __builtin_prefetch(rows[r] + j + kAhead);
      for (size_t c = 0; c < Channels; ++c) part[r][c] += f * from[c];
    }
  }
  std::memcpy(sums, part, sizeof part);
}

// Four entries of a list side by side, to hide the latency of additions. What follows in memory is mostly the next row,
// so it is asked for ahead.
template <size_t Channels, bool Weighted>
[[gnu::always_inline]] inline void listLoop(const uint32_t* ids, const float* values, size_t count, const double* b, double* sums) {
  constexpr size_t kStride = Channels == 3 ? 4 : 1, kSide = 4, kAhead = 128, kPerLine = 16;
  using Values = std::conditional_t<kStride == 1, double, Vector<double, 4>>;
  Values part[kSide] = {};
  for (size_t k = 0; k < count; k += kPerLine) {
    __builtin_prefetch(ids + k + kAhead);
    if constexpr (Weighted) __builtin_prefetch(values + k + kAhead);
    const auto add = [&](size_t l) __attribute__((always_inline)) {
      Values from;
      std::memcpy(&from, b + kStride * ids[k + l], sizeof from);
      if constexpr (Weighted)
        part[l % kSide] += static_cast<double>(values[k + l]) * from;
      else
        part[l % kSide] += from;
    };
    if (k + kPerLine <= count) {
#pragma GCC unroll 16
      for (size_t l = 0; l < kPerLine; ++l) add(l);
    } else {
      for (size_t l = 0; l < count - k; ++l) add(l);
    }
  }
  const Values sum = (part[0] + part[1]) + (part[2] + part[3]);
  std::memcpy(sums, &sum, Channels * sizeof(double));
}

// The loops for one kind of processor, whose registers hold the sums of GROUP rows. NOLINTBEGIN(bugprone-macro-parentheses)
#define FAROL_LOOPS_FOR(NAME, GROUP, TARGET)                                                                               \
  struct NAME {                                                                                                            \
    template <size_t Channels, typename Factor, size_t Rows>                                                               \
    TARGET static void dense(const Factor* const* rows, const double* b, size_t n, size_t last, Lanes (*sums)[Channels]) { \
      if constexpr (Rows > (GROUP)) {                                                                                      \
        dense<Channels, Factor, GROUP>(rows, b, n, last, sums);                                                            \
        dense<Channels, Factor, Rows - (GROUP)>(rows + (GROUP), b, n, last, sums + (GROUP));                               \
      } else {                                                                                                             \
        denseLoop<Channels, Factor, Rows>(rows, b, n, last, sums);                                                         \
      }                                                                                                                    \
    }                                                                                                                      \
    template <size_t Channels, bool Weighted>                                                                              \
    TARGET static void list(const uint32_t* ids, const float* values, size_t count, const double* b, double* sums) {       \
      listLoop<Channels, Weighted>(ids, values, count, b, sums);                                                           \
    }                                                                                                                      \
  };
// NOLINTEND(bugprone-macro-parentheses)
FAROL_LOOPS_FOR(Plain, 1, )
#if defined(__x86_64__)
FAROL_LOOPS_FOR(Avx2, 2, [[gnu::target("avx2,fma")]])
FAROL_LOOPS_FOR(Avx512, 8, [[gnu::target("avx512f,avx512vl,fma")]])
#endif
#undef FAROL_LOOPS_FOR

// `choose(X{})` for the best X that this processor has.
template <typename Choose>
auto chosen(Choose choose) {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl")) return choose(Avx512{});
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return choose(Avx2{});
#endif
  return choose(Plain{});
}

template <size_t Channels, bool Weighted>
void gatherList(std::span<const uint32_t> ids, const float* values, const double* b, double* sums) {
  static const auto list = chosen([](auto processor) { return &decltype(processor)::template list<Channels, Weighted>; });
  list(ids.data(), values, ids.size(), b, sums);
}

}  // namespace

template <size_t Channels, typename Factor>
void gatherRows(std::span<const Factor* const> rows, const double* b, size_t n, double (*sums)[Channels]) {
  constexpr size_t kGroup = 8;
  static const auto one = chosen([](auto processor) { return &decltype(processor)::template dense<Channels, Factor, 1>; });
  static const auto group = chosen([](auto processor) { return &decltype(processor)::template dense<Channels, Factor, kGroup>; });
  Lanes partial[kRowsAtOnce][Channels] = {};
  const size_t even = n / kLanes * kLanes;
  size_t done = 0;
  for (; done + kGroup <= rows.size(); done += kGroup) group(rows.data() + done, b, n, even, partial + done);
  for (; done < rows.size(); ++done) one(rows.data() + done, b, n, even, partial + done);
  for (size_t r = 0; r < rows.size(); ++r) {
    for (size_t c = 0; c < Channels; ++c) {
      double sum = 0;
      for (size_t k = 0; k < kLanes; ++k) sum += partial[r][c][k];
      for (size_t j = even; j < n; ++j) sum += static_cast<double>(rows[r][j]) * b[c * n + j];
      sums[r][c] = sum;
    }
  }
}

template <size_t Channels>
void gatherHits(std::span<const uint32_t> ids, double weight, const double* b, double* sums) {
  gatherList<Channels, false>(ids, nullptr, b, sums);
  for (size_t c = 0; c < Channels; ++c) sums[c] *= weight;
}

template <size_t Channels>
void gatherEntries(std::span<const uint32_t> ids, std::span<const float> values, const double* b, double* sums) {
  gatherList<Channels, true>(ids, values.data(), b, sums);
}

template void gatherRows(std::span<const float* const>, const double*, size_t, double (*)[3]);
template void gatherRows(std::span<const float* const>, const double*, size_t, double (*)[1]);
template void gatherRows(std::span<const uint16_t* const>, const double*, size_t, double (*)[3]);
template void gatherRows(std::span<const uint16_t* const>, const double*, size_t, double (*)[1]);
template void gatherHits<3>(std::span<const uint32_t>, double, const double*, double*);
template void gatherHits<1>(std::span<const uint32_t>, double, const double*, double*);
template void gatherEntries<3>(std::span<const uint32_t>, std::span<const float>, const double*, double*);
template void gatherEntries<1>(std::span<const uint32_t>, std::span<const float>, const double*, double*);

}  // namespace farol
